"""What is wrong with a kernel by its looks, whatever it does to the photo.

A hand leads a camera along a path: its kernel hangs together, is wider than a point, and lies well
within the bounds of the estimate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import binary_dilation, label

from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel

__all__ = [
    "COLLAPSED",
    "FILLED",
    "SCATTERED",
    "TOUCHING",
    "faults",
    "is_filled",
    "is_point",
    "spread_px",
]

COLLAPSED = "the kernel is hardly more than a point: little of a shake was found"
TOUCHING = "the kernel touches its bounds: try a larger --blur-size"
SCATTERED = "the kernel is scattered like noise: compare the result with the photo"
FILLED = "the blur is filled like a disk: the photo is out of focus rather than shaken"

_POINT = 0.9  # share of the weight within a step of the heaviest rotation that makes a point
_OUTSIDE = 0.02  # share of the weight beyond the bound that calls for a larger one
_WIDEST = 0.3  # of the shorter side: estimates without a bound go little further
_PATH = 0.7  # share of the weight that hangs together, at least
_DISK = 0.7  # of the cells of its spread that a filled kernel takes: disks .79 to .98, paths .56
_LEAST_DISK = 0.65  # steps, standard deviation: less is a point
_MOST_CELLS = 1 << 24  # of the grid that the rotations are laid out on


def faults(kernel: RotationKernel, *, blur_px: float | None = None) -> list[str]:
    """Tell what is wrong with an estimated kernel, in plain words.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel, on the grid that it was estimated on, centred.
    blur_px : float, optional
        Bound of the blur that was looked for, in pixels of the kernel's camera; by default most
        of what is looked for where no bound is given.

    Returns
    -------
    list of str
        Of `COLLAPSED`, `TOUCHING`, `SCATTERED` and `FILLED`; empty if nothing is wrong.

    """
    if is_point(kernel):
        return [COLLAPSED]
    found = []
    bound = _WIDEST * min(kernel.camera.shape) if blur_px is None else blur_px
    # one step at least beyond the bound: estimates leave a little room
    half = bound / 2 * grid_steps(kernel.camera) + kernel.steps
    if kernel.weights[np.any(np.abs(kernel.theta) > half, 1)].sum() > _OUTSIDE:
        found.append(TOUCHING)
    if _connected_share(kernel) < _PATH:
        found.append(SCATTERED)
    if is_filled(kernel):
        found.append(FILLED)
    return found


def is_point(kernel: RotationKernel) -> bool:
    """Tell whether nearly all weight lies within a step of the heaviest rotation."""
    from_heaviest = np.abs(kernel.theta - kernel.theta[np.argmax(kernel.weights)])
    near = np.all(from_heaviest < 1.5 * kernel.steps, 1)
    return bool(kernel.weights[near].sum() > _POINT)


def spread_px(kernel: RotationKernel) -> float:
    """Standard deviation of a kernel along its longest axis, in pixels of its camera.

    An even path as long as l has ``l / sqrt(12)``.
    """
    moved = kernel.theta / grid_steps(kernel.camera)
    spread = np.cov(moved.T, aweights=kernel.weights, ddof=0)
    return float(np.sqrt(max(np.linalg.eigvalsh(spread)[-1], 0.0)))


def is_filled(kernel: RotationKernel) -> bool:
    """Tell whether a kernel fills a disk, as that of a lens out of focus does.

    A path of the same spread, however it winds, leaves most of the disk empty. An even disk, or a
    Gaussian, of standard deviation s takes ``4 pi s^2`` cells, counted as ``1 / sum w^2``; along
    the longest axis, any other shape takes fewer.
    """
    places = kernel.indices[:, :2]
    low = places.min(0)
    shape = tuple(places.max(0) - low + 1)
    if np.prod(shape, dtype=np.float64) > _MOST_CELLS:
        return False
    cells = np.zeros(shape)
    np.add.at(cells, tuple((places - low).T), kernel.weights)
    spread = np.cov(places.T, aweights=kernel.weights, ddof=0)
    longest = float(np.linalg.eigvalsh(spread)[-1])
    if longest < _LEAST_DISK**2:
        return False
    taken = 1 / float((cells**2).sum())
    return taken > _DISK * 4 * np.pi * (longest + 1 / 12)  # a cell is no point


def _connected_share(kernel: RotationKernel) -> float:
    """Share of the weight in the largest part that hangs together, gaps of two steps bridged."""
    indices = kernel.indices - kernel.indices.min(0) + 1
    shape = tuple(indices.max(0) + 2)
    if np.prod(shape, dtype=np.float64) > _MOST_CELLS:
        return 0.0
    used = np.zeros(shape, bool)
    used[tuple(indices[kernel.weights > 0].T)] = True
    near = np.ones((3, 3, 3), bool)
    parts, count = label(binary_dilation(used, near), near)
    shares = np.bincount(parts[tuple(indices.T)], kernel.weights, count + 1)
    return float(shares.max())
