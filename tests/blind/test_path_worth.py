"""What the paths along a kernel are worth in the search."""

from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.camera_path import SmoothPath
from deshake.blind.judge import Judge
from deshake.blind.path_worth import PathWorth
from deshake.blind.spectral_match import SpectralMatch, match_of_path, mean_match
from deshake.geometry.camera import Camera
from deshake.run import Run

CAMERA = Camera.from_focal(420.0, 300, 420)


def test_margin_and_match_count_in_full_and_near_a_path(shake) -> None:
    photo = shake(CAMERA, path=np.array([[0.0, -9, 0], [3, 0, 0], [-2, 9, 0]]))
    judges = Judge.batches(photo.pyramid, 0, photo.kernel)
    spectra = [SpectralMatch(photo.pyramid, 0, "fitted")]
    worth = PathWorth(judges, spectra, 0.5, photo.camera, Run(1))
    path = SmoothPath.through(photo.kernel, photo.camera)[0]
    kernel = path.kernel(photo.camera)
    match = 0.5 * mean_match(spectra, kernel)
    margin = float(np.mean([judge.margin(kernel) for judge in judges]))
    assert worth.of(kernel) == pytest.approx(margin + match)
    assert len(judges) > 1
    near = judges[1].margin(kernel) + 0.5 * match_of_path(spectra, path)[0]
    assert worth.around(1, path)(path) == pytest.approx(near)
