"""The path of the camera while the shutter was open: drawn at random, or read from a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deshake.errors import DeshakeError
from deshake.files.disk import read_bytes
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import compose, displacements, homographies

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from deshake.geometry.camera import Camera

__all__ = ["CameraPath", "random_path", "read_path"]

_EXPOSURE = 0.5  # s: duration of a random path
_TREMOR_HZ = 12.0  # Hz: highest frequency of a random path; hands hardly move faster
_PIECE_PX = 0.5  # px: longest piece of a path
_LONGEST_PX = 10_000  # px: a longer path is an error
_WIDEST_TURN = 20.0  # degrees: a wider turn is an error
_HINT = "angles are in degrees; give the part of the path while the shutter was open"
_MOST_BYTES = 50_000_000  # bytes of a path's file, at most


@dataclass(frozen=True, eq=False)
class CameraPath:
    """Orientations of the camera while the shutter was open.

    Parameters
    ----------
    theta : (T, 3) array of float64
        Successive angle-axis orientations in radians; the camera turns evenly between two.
    durations : (T - 1,) array of float64, optional
        Time from each to the next, in any unit; by default equal.

    Raises
    ------
    ValueError
        If the path is empty or not finite, or the durations do not fit.

    """

    theta: NDArray[np.float64]
    durations: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        theta = np.array(self.theta, np.float64)
        if theta.ndim != 2 or theta.shape[1] != 3 or len(theta) == 0:
            raise ValueError("a camera path is a (T, 3) array of angles")
        count = len(theta) - 1
        times = np.ones(count) if self.durations is None else np.array(self.durations, np.float64)
        if not (np.isfinite(theta).all() and np.isfinite(times).all()):
            raise ValueError("a camera path is finite")
        if times.shape != (count,) or np.any(times < 0) or (count > 0 and times.sum() <= 0):
            raise ValueError("durations are one number >= 0 for each stretch of the path")
        object.__setattr__(self, "theta", theta)
        object.__setattr__(self, "durations", times if count else None)

    def kernel(self, camera: Camera) -> RotationKernel:
        """Bin the path on the camera's grid."""
        return RotationKernel.from_path(self.theta, camera, durations=self.durations)

    def centred(self, camera: Camera) -> CameraPath:
        """Return the path turned so that the centroid of its kernel is the origin.

        Raises
        ------
        DeshakeError
            If the path leads too far away from its middle, or is too long.

        """
        path = CameraPath(compose(-self.theta[len(self.theta) // 2], self.theta), self.durations)
        if np.linalg.norm(path.theta, axis=1).max() > np.deg2rad(_WIDEST_TURN):
            raise DeshakeError(
                f"the camera path turns by more than {_WIDEST_TURN:.0f} degrees", hint=_HINT
            )
        path._along(camera)
        for _ in range(3):  # the mean of angle-axis vectors is not exactly equivariant
            path = CameraPath(compose(-path.kernel(camera).centroid, path.theta), path.durations)
        return path

    def extent_px(self, camera: Camera) -> float:
        """Widest spread of the displacements over the frame, along x or y, in pixels."""
        moved = displacements(homographies(camera, self.theta), camera.corners)
        return float(np.ptp(moved, axis=1).max())

    def pieces(self, camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Cut the path into pieces during which no pixel moves by more than half a pixel.

        Returns
        -------
        theta : (K, 3) array
            The middle of each piece, in radians.
        weights : (K,) array
            The share of the exposure that the camera spent on it.

        Raises
        ------
        DeshakeError
            If the path is too long.

        """
        if self.durations is None:
            return self.theta, np.ones(1)
        along = self._along(camera)
        clock = np.concatenate([[0.0], np.cumsum(self.durations)]) / self.durations.sum()
        ends = np.linspace(0, along[-1], max(int(np.ceil(along[-1] / _PIECE_PX)), 1) + 1)
        elapsed = np.interp(ends, along, clock)
        elapsed[0], elapsed[-1] = 0, 1  # with the time of rest at both ends
        middles = (ends[1:] + ends[:-1]) / 2
        theta = np.stack([np.interp(middles, along, axis) for axis in self.theta.T], 1)
        return theta, np.diff(elapsed)

    def _along(self, camera: Camera) -> NDArray[np.float64]:
        """Return the path length up to each orientation, (T,), in pixels of the fastest corner."""
        moved = displacements(homographies(camera, self.theta), camera.corners)
        lengths = np.linalg.norm(np.diff(moved, axis=1), axis=2).max(0)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        if along[-1] > _LONGEST_PX:
            raise DeshakeError(f"the camera path is {along[-1]:.0f} pixels long", hint=_HINT)
        return along


def random_path(camera: Camera, blur_px: float, *, seed: int = 0, samples: int = 251) -> CameraPath:
    """Draw a smooth path about all three axes, such as a hand's tremor makes in half a second.

    Each axis is noise whose power falls as 1/f^2 (its angular velocity is white) and ends near
    12 Hz: hands hardly move faster. All have the same strength on average.

    Parameters
    ----------
    camera : Camera
        The camera that is shaken.
    blur_px : float
        Extent of the blur over the frame in pixels, > 0.
    seed : int
        The same seed gives the same path.
    samples : int
        Number T of orientations, >= 2.

    Raises
    ------
    ValueError
        If the extent or the samples are too small.
    DeshakeError
        If the extent is more than half of the frame.

    """
    if not blur_px > 0 or samples < 2:
        raise ValueError("a random path has an extent above 0 and at least 2 samples")
    if blur_px > max(camera.shape) / 2:
        raise DeshakeError(
            f"a shake of {blur_px:g} pixels sweeps more than half of the frame",
            hint="shake it less, or take a larger photo",
        )
    rng = np.random.default_rng(seed)
    period = 4 * samples  # longer than the path, whose ends then differ
    frequency = np.fft.rfftfreq(period, _EXPOSURE / samples)[1:]
    amplitude = np.exp(-((frequency / _TREMOR_HZ) ** 2)) / frequency
    phases = rng.normal(size=(3, 2, len(frequency)))
    spectrum = np.pad((phases[:, 0] + 1j * phases[:, 1]) * amplitude, ((0, 0), (1, 0)))
    theta = np.fft.irfft(spectrum, period)[:, :samples].T
    theta *= 1e-3 / np.abs(theta).max()
    for _ in range(4):  # displacements are nearly linear in the angles
        theta *= blur_px / CameraPath(theta).extent_px(camera)
        theta -= theta.mean(0)
    return CameraPath(theta)


def read_path(file: str | Path) -> CameraPath:
    """Read a camera path from a text file of rows ``rx, ry, rz`` or ``t, rx, ry, rz``.

    Angles are in degrees about X (right), Y (down) and Z (into the scene), times t in any unit.
    Commas, semicolons, blanks and tabs separate; one line of headings and lines that begin with
    ``#`` are skipped.

    Raises
    ------
    DeshakeError
        If the file cannot be read or is not such a table, or if time runs backwards.

    """
    try:
        lines = read_bytes(file, _MOST_BYTES, DeshakeError).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise DeshakeError("not a text file", file=file) from None
    rows: list[list[float]] = []
    headings = 0
    for number, line in enumerate(lines, 1):
        words = line.replace(",", " ").replace(";", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            rows.append([float(word) for word in words])
        except ValueError:
            if rows or headings:
                raise DeshakeError(f"line {number} is not a row of numbers", file=file) from None
            headings += 1
            continue
        if len(rows[-1]) not in {3, 4} or len(rows[-1]) != len(rows[0]):
            raise DeshakeError(
                f"line {number} has {len(rows[-1])} numbers",
                hint="each row is rx, ry, rz or t, rx, ry, rz, with angles in degrees",
                file=file,
            )
    if not rows:
        raise DeshakeError("no rows of numbers in it", file=file)
    table = np.array(rows)
    angles = table[:, -3:]
    if not np.isfinite(table).all() or np.abs(angles).max() > 90:
        raise DeshakeError("angles are numbers of degrees from -90 to 90", file=file)
    durations = np.diff(table[:, 0]) if table.shape[1] == 4 and len(table) > 1 else None
    if durations is not None and (durations.min() < 0 or durations.sum() <= 0):
        raise DeshakeError("the times in the first column must rise", file=file)
    return CameraPath(np.deg2rad(angles), durations)
