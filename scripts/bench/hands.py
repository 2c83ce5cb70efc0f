"""Recorded paths of hand-held cameras, for the cases that are shaken by hands.

Two kinds of recordings are read. The logs of a phone's orientation (Park & Levoy, CVPR 2014) have
two lines of header, then time, sensor time in nanoseconds and a rotation matrix, 200 times a
second. A `gyro.txt` (Lai et al., CVPR 2016) has rates about three axes, and times in seconds.
Nothing of deshake is used here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from bench.errors import MissingDataError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

__all__ = ["find_logs", "read_recording"]


def find_logs(folder: Path) -> list[Path]:
    """Find the orientation logs of a folder; raise MissingDataError where there are none."""
    for place in (folder, folder / "nexus5", folder / "gyro" / "nexus5"):
        logs = sorted(place.glob("*.txt"))
        if logs:
            return logs
    raise MissingDataError(f"{folder}: no orientation logs (*.txt); --data names their folder")


def read_recording(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read times (T,) in seconds and orientations (T, 3, 3)."""
    if path.name == "gyro.txt":
        table = np.loadtxt(path)
        times, turned = table[:, 6], [np.eye(3)]
        for rate, step in zip(table[1:, 3:6], np.diff(times), strict=True):
            turned.append(turned[-1] @ cv2.Rodrigues(rate * step)[0])
        return times, np.array(turned)
    times, matrices = [], []
    for line in path.read_text("utf-8").splitlines()[2:]:
        fields = line.replace("[", "").replace("]", "").split(",")
        if len(fields) >= 11:
            times.append(int(fields[1]) * 1e-9)
            matrices.append([float(field) for field in fields[2:11]])
    return np.array(times), np.array(matrices).reshape(-1, 3, 3)
