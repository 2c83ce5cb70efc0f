"""Exhaustive search for the rotation between two photos, on small copies of them (Sec. 7).

Rotations about X and Y nearly shift a picture. So the search tries a few steps about X and Y, and
all steps about Z; an FFT tries all shifts around each of them at once. The score is the
zero-normalised cross-correlation (ZNCC) where both pictures have pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from deshake.blind.variational.coarse_to_fine import warped
from deshake.geometry.rotations import compose, displacements, grid_steps, homographies
from deshake.operators.strips import in_order
from deshake.pair.registration_settings import SETTINGS
from deshake.run import Run

if TYPE_CHECKING:
    from deshake.geometry.camera import Camera

__all__ = ["Candidate", "distance_px", "distinct", "exhaustive_search"]

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A rotation ``H`` with ``a(x) ~ b(H^-1 x)``, (3,) in radians, and its ZNCC."""

    theta: NDArray[np.float64]
    score: float


def exhaustive_search(
    a: Image,
    b: Image,
    camera: Camera,
    max_angle: float,
    *,
    run: Run = Run(),
) -> list[Candidate]:
    """Try all rotations within a cube: ``a(x) ~ b(H^-1 x)``.

    Parameters
    ----------
    a, b : (h, w) arrays of float32
        The photos, small, without their means and slow variations.
    camera : Camera
        The camera of both, at this size.
    max_angle : float
        Half the side of the cube about each axis, in radians.
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    list of Candidate
        The best shift at each step about X, Y and Z, best first.

    """
    steps = _steps(camera, max_angle)
    half = max_angle / _tilts(camera, max_angle)  # of the way between two steps about X or Y
    reach = int(np.ceil(1.05 * camera.focal_px * np.tan(half))) + 1
    correlate = _Correlation(a, min(reach, min(camera.shape) - 1))
    pictures = np.stack([b, np.ones_like(b)])

    def best_shift(h: NDArray[np.float64]) -> tuple[float, int, int]:
        return correlate.best(*warped(pictures, camera, h))

    shifts = []
    for _, shift in in_order(best_shift, list(homographies(camera, -steps)), run):
        shifts.append(shift)
        run.report(len(shifts) / len(steps), "registering")
    scores, dx, dy = np.array(shifts).T
    turns = np.arctan2(np.stack([-dy, dx, 0 * dx], -1), camera.focal_px)
    candidates = map(Candidate, compose(turns, steps), scores.tolist())
    return sorted(candidates, key=lambda candidate: -candidate.score)


def distinct(
    candidates: list[Candidate], camera: Camera, count: int, apart_px: float
) -> list[Candidate]:
    """Return the first `count` candidates; any two are at least `apart_px` apart."""
    kept: list[Candidate] = []
    for candidate in candidates:
        if len(kept) == count:
            break
        if all(distance_px(camera, candidate.theta, k.theta) > apart_px for k in kept):
            kept.append(candidate)
    return kept


def distance_px(camera: Camera, one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the root mean square distance of a pixel's places by two rotations, over the frame."""
    moved = displacements(homographies(camera, compose(-one, other)[None]), camera.corners)
    return float(np.sqrt(np.mean(np.sum(moved**2, -1))))


def _tilts(camera: Camera, max_angle: float) -> int:
    """Return the number of steps about X, and about Y; shifts can fill the gaps between them."""
    corner = np.abs(camera.corners - camera.matrix[:2, 2]).max(0)
    bent = 2 * max_angle * float(corner @ corner) / camera.focal_px
    count = int(np.ceil(bent / SETTINGS.bent_px)) // 2 * 2 + 1  # the middle one is no rotation
    return min(count, SETTINGS.most_tilts)


def _steps(camera: Camera, max_angle: float) -> NDArray[np.float64]:
    """Return the rotations (K, 3) that are tried, each with all shifts around it."""
    count = _tilts(camera, max_angle)
    tilts = (np.arange(count) - (count - 1) / 2) * (2 * max_angle / count)
    turns = int(np.ceil(max_angle / grid_steps(camera)[2]))
    rolls = np.linspace(-max_angle, max_angle, 2 * turns + 1)
    return np.array(list(product(tilts, tilts, rolls)))


class _Correlation:
    """ZNCC of a picture with others, each within its mask, for all shifts up to `reach`."""

    def __init__(self, a: Image, reach: int) -> None:
        self.least = SETTINGS.least_overlap * a.size
        self.size = tuple(scipy.fft.next_fast_len(side + reach, real=True) for side in a.shape)
        self.shifts = np.arange(-reach, reach + 1)
        self.spectra = scipy.fft.rfft2(np.stack([a, a * a, np.ones_like(a)]), self.size)

    def best(self, b: Image, mask: Image) -> tuple[float, int, int]:
        """Return the best ZNCC with ``b(x - d)``, and the shift d: (dx, dy)."""
        spectra = scipy.fft.rfft2(np.stack([b, mask, b * b]), self.size).conj()
        products = np.concatenate([self.spectra * spectra, self.spectra[2:] * spectra[1:2]])
        around = scipy.fft.irfft2(products, self.size)[:, self.shifts[:, None], self.shifts]
        cross, energy_a, energy_b, overlap = around
        score = cross / np.sqrt(np.maximum(energy_a * energy_b, 1e-12))
        score[overlap < self.least] = -1
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        return float(score[row, column]), int(self.shifts[column]), int(self.shifts[row])
