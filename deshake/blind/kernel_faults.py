"""Faults of a kernel that its shape alone shows, without the photo.

A hand moves a camera along a path. So a good kernel is connected, is wider than a point, and lies
well within the bounds of the estimate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.ndimage import binary_dilation, label

from deshake.blind.settings import SETTINGS
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
]

COLLAPSED = "hardly any shake was found: the kernel is little more than a point"
TOUCHING = "the shake may be wider than what was looked for: try a larger --blur-size"
SCATTERED = "the estimate of the shake is scattered like noise: compare the result with the photo"
FILLED = "the blur is a round spot, not a path: the photo is out of focus rather than shaken"

_S: Final = SETTINGS.kernel_faults


def faults(kernel: RotationKernel, *, blur_px: float | None = None) -> list[str]:
    """List the faults of an estimated kernel, in plain words.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel, on the grid that it was estimated on, centred.
    blur_px : float, optional
        Bound of the blur in the estimate, in pixels of the kernel's camera; by default 0.3 of the
        frame's shorter side.

    Returns
    -------
    list of str
        Some of `COLLAPSED`, `TOUCHING`, `SCATTERED` and `FILLED`; empty without a fault.

    """
    if is_point(kernel):
        return [COLLAPSED]
    result = []
    bound = _S.widest * min(kernel.camera.shape) if blur_px is None else blur_px
    # at least one step beyond the bound: an estimate leaves a little room there
    half = bound / 2 * grid_steps(kernel.camera) + kernel.steps
    if kernel.weights[np.any(np.abs(kernel.theta) > half, 1)].sum() > _S.outside:
        result.append(TOUCHING)
    if _connected_share(kernel) < _S.path:
        result.append(SCATTERED)
    if is_filled(kernel):
        result.append(FILLED)
    return result


def is_point(kernel: RotationKernel) -> bool:
    """Return whether nearly all weight lies within a step of the heaviest rotation."""
    from_heaviest = np.abs(kernel.theta - kernel.theta[np.argmax(kernel.weights)])
    near = np.all(from_heaviest < 1.5 * kernel.steps, 1)
    return bool(kernel.weights[near].sum() > _S.point)


def is_filled(kernel: RotationKernel) -> bool:
    """Return whether a kernel fills a disk, as the kernel of a lens out of focus does.

    The test counts the cells that the kernel takes, as ``1 / sum w^2``. An even disk or a Gaussian
    of standard deviation s takes ``4 pi s^2`` cells. Any other shape with the same longest axis
    takes fewer: a path of the same spread leaves most of the disk empty.
    """
    places = kernel.indices[:, :2]
    low = places.min(0)
    shape = tuple(places.max(0) - low + 1)
    if np.prod(shape, dtype=np.float64) > _S.most_cells:
        return False
    cells = np.zeros(shape)
    np.add.at(cells, tuple((places - low).T), kernel.weights)
    spread = np.cov(places.T, aweights=kernel.weights, ddof=0)
    longest = float(np.linalg.eigvalsh(spread)[-1])
    if longest < _S.least_disk**2:
        return False
    taken = 1 / float((cells**2).sum())
    return taken > _S.disk * 4 * np.pi * (longest + 1 / 12)  # 1/12: the variance within a cell


def _connected_share(kernel: RotationKernel) -> float:
    """Return the share of weight in the largest connected part; gaps of two steps are bridged."""
    indices = kernel.indices - kernel.indices.min(0) + 1
    shape = tuple(indices.max(0) + 2)
    if np.prod(shape, dtype=np.float64) > _S.most_cells:
        return 0.0
    used = np.zeros(shape, bool)
    used[tuple(indices[kernel.weights > 0].T)] = True
    near = np.ones((3, 3, 3), bool)
    parts, count = label(binary_dilation(used, near), near)
    shares = np.bincount(parts[tuple(indices.T)], kernel.weights, count + 1)
    return float(shares.max())
