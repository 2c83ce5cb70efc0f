"""Kernels of very wide shakes, from the whole frame at coarse scales.

A candidate's kernel grows from a point. If the shake is as wide as a tenth of the frame, the first
scales are too small for that: the kernel grows until it is as wide as the frame. Here the kernel
has a fixed room from the beginning, a disk, and the frame is a single tile. So every edge counts,
also those near the border. One filter serves for the whole frame. The roll follows in the race.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.blind.candidate import edge_floor, first_kernel
from deshake.blind.kernel_step import RotationGrid, fitted_weights
from deshake.blind.settings import SETTINGS
from deshake.blind.sharp_edges import latent_edges
from deshake.blind.tiles import Tiles
from deshake.blind.trimming import heaviest
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.strips import in_order
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from deshake.blind.candidate import Axes
    from deshake.run import Run
    from deshake.signal.pyramid import Pyramid, Scale

__all__ = ["wide_starts"]

Indices = NDArray[np.int64]

_S: Final = SETTINGS.wide_start


def wide_starts(pyramid: Pyramid, axes: Axes, run: Run) -> list[tuple[int, RotationKernel]]:
    """Estimate kernels of wide shakes, without roll.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    axes : three bools
        The axes that the camera may turn about.
    run : Run
        Threads to use.

    Returns
    -------
    list of (level, kernel)
        The scale of each estimate, and the kernel for the camera of the photo, centred.

    """
    levels = [
        level
        for level in range(pyramid.coarsest + 1)
        if _S.sides[0] <= min(pyramid.camera_at(level).shape) <= _S.sides[1]
    ]
    jobs = [(level, last) for level in levels for last in _S.last]
    work = in_order(lambda job: _estimated(pyramid, *job, axes), jobs, run)
    return [(level, kernel) for (level, _), kernel in work]


def _estimated(pyramid: Pyramid, level: int, last: float, axes: Axes) -> RotationKernel:
    """Estimate a kernel from coarse to fine; the last scale is `level`."""
    scales = 1 + int(np.log(_S.reach / _S.least_reach) / np.log(RATIO))
    prices = iter(np.geomspace(_S.first, last, scales * _S.iterations))
    kernel = first_kernel(pyramid.camera_at(level + scales - 1), (axes[0], axes[1], False))
    for coarser in reversed(range(scales)):
        scale = pyramid.at(level + coarser)
        half = int(np.ceil(_S.reach / RATIO**coarser))
        indices = _disk(half, axes)
        steps = grid_steps(scale.camera)
        tile = _whole_frame(scale, half)
        grid = RotationGrid(tile, indices, steps)
        weights = _weights_at(indices, kernel.for_camera(scale.camera).resampled(steps))
        floor = edge_floor(pyramid, level + coarser)
        for _ in range(_S.iterations):
            tile.bind(RotationKernel.from_indices(indices, weights, steps, scale.camera))
            fit = grid.equations(latent_edges(tile, max(next(prices), floor), "l0"))
            weights = fitted_weights(fit, indices, weights, cut=_S.cut)
        kernel = RotationKernel.from_indices(indices, weights, steps, scale.camera)
        kernel = heaviest(kernel, _S.light).centred()
    return kernel.for_camera(pyramid.camera)


def _whole_frame(scale: Scale, half: int) -> Tiles:
    """Return one square tile around the frame; the pixels beyond the frame are unknown."""
    height, width = scale.camera.shape
    side = max(height, width) // 2 * 2
    return Tiles(scale, [((height - side) // 2, (width - side) // 2)], side, half + 1)


def _disk(radius: int, axes: Axes) -> Indices:
    """Return the rotations about X and Y within a radius, in grid steps, (K, 3)."""
    along = [np.arange(-radius, radius + 1) if axis else np.zeros(1, int) for axis in axes[:2]]
    tilt, pan = (grid.ravel() for grid in np.meshgrid(*along, indexing="ij"))
    within = tilt**2 + pan**2 <= (radius + 0.5) ** 2
    indices: Indices = np.stack([tilt, pan, np.zeros_like(pan)], 1)[within]
    return indices


def _weights_at(indices: Indices, kernel: RotationKernel) -> NDArray[np.float64]:
    """Return the weights of a kernel at rotations of its grid; others are discarded."""
    held = {tuple(at): w for at, w in zip(kernel.indices.tolist(), kernel.weights, strict=True)}
    weights = np.array([held.get(tuple(at), 0.0) for at in indices.tolist()])
    normed: NDArray[np.float64] = weights / weights.sum()
    return normed
