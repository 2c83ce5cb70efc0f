"""Recorded paths of hand-held cameras, for the benchmarks that shake photos.

The logs are those of a phone's orientation (Hee Park & Levoy, CVPR 2014): two lines of header,
then time, sensor time in nanoseconds and a rotation matrix, 200 times a second.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deshake.errors import DeshakeError
from deshake.geometry.rotations import angle_axis

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

__all__ = ["find_logs", "hand_path", "read_log"]

EXPOSURES = (0.125, 0.8)  # s


def find_logs(folder: Path) -> list[Path]:
    """Find the orientation logs of a folder; raise DeshakeError where there are none."""
    for place in (folder, folder / "nexus5", folder / "gyro" / "nexus5"):
        logs = sorted(place.glob("*.txt"))
        if logs:
            return logs
    raise DeshakeError(
        "no orientation logs", file=folder, hint="--data names the folder of the *.txt logs"
    )


def read_log(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read times (T,) in seconds and rotation matrices (T, 3, 3)."""
    times, matrices = [], []
    for line in path.read_text("utf-8").splitlines()[2:]:
        fields = line.replace("[", "").replace("]", "").split(",")
        if len(fields) >= 11:
            times.append(int(fields[1]) * 1e-9)
            matrices.append([float(field) for field in fields[2:11]])
    return np.array(times), np.array(matrices).reshape(-1, 3, 3)


def hand_path(
    logs: Sequence[Path],
    rng: np.random.Generator,
    exposures: tuple[float, float] = EXPOSURES,
) -> NDArray[np.float64]:
    """Cut a window as long as an exposure (s, of a range) out of a log.

    Returned are orientations (T, 3) of the camera against its middle one.
    """
    times, matrices = read_log(logs[rng.integers(len(logs))])
    exposure = rng.uniform(*exposures)
    start = times[0] + rng.uniform() * (times[-1] - times[0] - exposure)
    exposed = matrices[(times >= start) & (times < start + exposure)]
    turned = np.einsum("nij,ik->njk", exposed, exposed[len(exposed) // 2])
    return angle_axis(turned) * [1, -1, -1]  # from the phone's axes to the camera's
