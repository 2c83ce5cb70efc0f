"""Kernels of very wide shakes, from the whole frame at coarse scales.

A candidate's kernel grows from a point. If the shake is as wide as a tenth of the frame, the first
scales are too small for that: the kernel grows until it is as wide as the frame. Here the kernel
has a fixed room from the beginning, a disk, and the frame is a single tile. So every edge counts,
also those near the border. One filter serves for the whole frame. The roll follows in the race.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.blind.candidate import edge_floor, first_kernel
from deshake.blind.kernel_step import RotationGrid, fitted_weights
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

_REACH = 15  # px of the last scale: radius of the kernel's room
_LEAST_REACH = 2.5  # px: the same at the first scale
_SIDES = (110, 300)  # px: least and largest shorter side of the frame at the last scale
_FIRST = 0.1  # squared contrast of the pyramid: price of an edge in the first iteration
_LAST = (2e-3, 2e-2)  # the same in the last iteration; the second for photos of low contrast
_ITERATIONS = 5  # at each scale
_CUT = 0.03  # share of the kernel's weight; smaller weights that hold less together are noise
_LIGHT = 1e-4  # share of the kernel's weight; rotations that hold less are discarded


def wide_starts(pyramid: Pyramid, axes: Axes, run: Run) -> list[tuple[int, RotationKernel]]:
    """Estimate kernels of wide shakes, without roll.

    The settings are tuned on photos of 6 MP shaken by 120 px, and of .6 MP by 100 to 140 px.

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
        if _SIDES[0] <= min(pyramid.at(level).camera.shape) <= _SIDES[1]
    ]
    jobs = [(level, last) for level in levels for last in _LAST]
    work = in_order(lambda job: _estimated(pyramid, *job, axes), jobs, run)
    return [(level, kernel) for (level, _), kernel in work]


def _estimated(pyramid: Pyramid, level: int, last: float, axes: Axes) -> RotationKernel:
    """Estimate a kernel from coarse to fine; the last scale is `level`."""
    scales = 1 + int(np.log(_REACH / _LEAST_REACH) / np.log(RATIO))
    prices = iter(np.geomspace(_FIRST, last, scales * _ITERATIONS))
    kernel = first_kernel(pyramid.at(level + scales - 1).camera, (axes[0], axes[1], False))
    for coarser in reversed(range(scales)):
        scale = pyramid.at(level + coarser)
        half = int(np.ceil(_REACH / RATIO**coarser))
        indices = _disk(half, axes)
        steps = grid_steps(scale.camera)
        tile = _whole_frame(scale, half)
        grid = RotationGrid(tile, indices, steps)
        weights = _weights_at(indices, kernel.for_camera(scale.camera).resampled(steps))
        floor = edge_floor(pyramid, level + coarser)
        for _ in range(_ITERATIONS):
            tile.bind(RotationKernel.from_indices(indices, weights, steps, scale.camera))
            fit = grid.equations(latent_edges(tile, max(next(prices), floor), "l0"))
            weights = fitted_weights(fit, indices, weights, cut=_CUT)
        kernel = RotationKernel.from_indices(indices, weights, steps, scale.camera)
        kernel = heaviest(kernel, _LIGHT).centred()
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
