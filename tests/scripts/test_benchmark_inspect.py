from __future__ import annotations

import json

import numpy as np
import pytest
from benchmark_inspect import truth
from shake_cases import Case


def test_the_truth_is_the_path_in_the_middle_of_the_frame(tmp_path):
    case = Case("O01", "astronaut", 0.3, 20, 92, "mid", 0.1)
    (tmp_path / "O01.json").write_text(json.dumps({"shape": [400, 600]}))
    # Turns about Y move the middle sideways, turns about X upwards; a roll does not move it.
    angle = np.linspace(-0.01, 0.01, 21)
    theta = np.stack([0.5 * angle, angle, 3 * angle], 1)
    np.savez(tmp_path / "O01_path.npz", theta=theta, f=500.0)
    known = truth(tmp_path, case)
    assert known.extent == pytest.approx(500 * 0.02 * np.hypot(1, 0.5), rel=0.01)
    assert known.sigma[1] < 0.05 * known.sigma[0]
    # About X, a positive angle moves the picture up where one about Y moves it to the right.
    assert known.direction == pytest.approx(np.degrees(np.arctan(0.5)), abs=1)


def test_a_photo_that_is_not_shaken_has_no_path(tmp_path):
    assert truth(tmp_path, Case("S01", "astronaut", 0.3, 0, 92, "mid")) is None
