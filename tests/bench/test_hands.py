from __future__ import annotations

import cv2
import numpy as np
import pytest
from bench.errors import MissingDataError
from bench.hands import find_logs, read_recording


def test_both_kinds_of_recordings_have_the_same_orientations(tmp_path):
    rate, times = np.array([0.1, -0.2, 0.3]), 0.01 * np.arange(30)
    turned = [cv2.Rodrigues(rate * time)[0] for time in times]
    lines = ["start", "focal"]
    for time, matrix in zip(times, turned, strict=True):
        numbers = ", ".join(f"{number:.9f}" for number in matrix.ravel())
        lines.append(f"{round(1000 * time)}, {round(1e9 * time)}, [{numbers}]")
    (tmp_path / "log.txt").write_text("\n".join(lines), "utf-8")
    rows = np.column_stack([np.zeros((30, 3)), np.tile(rate, (30, 1)), times])
    np.savetxt(tmp_path / "gyro.txt", rows)
    for name in ("log.txt", "gyro.txt"):
        read_times, matrices = read_recording(tmp_path / name)
        np.testing.assert_allclose(read_times, times, atol=1e-9)
        np.testing.assert_allclose(matrices, turned, atol=1e-8)


@pytest.mark.parametrize("below", ["", "nexus5", "gyro/nexus5"])
def test_logs_are_looked_for_below_the_folder(tmp_path, below):
    with pytest.raises(MissingDataError, match="--data names their folder"):
        find_logs(tmp_path)
    (tmp_path / below).mkdir(parents=True, exist_ok=True)
    log = tmp_path / below / "a.txt"
    log.touch()
    assert find_logs(tmp_path) == [log]
