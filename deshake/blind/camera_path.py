"""A kernel that was estimated at a coarse scale, made continuous along the camera's path.

A camera moves without a break. A kernel found where a pixel is several of the photo's is a row of
spikes that are as far apart, and leaves dotted rims behind at full size. So every rotation shares
its weight with the stretches towards its neighbours on the grid, in proportion to their weights:
the kernel is filled along the path, and gets no wider across it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

__all__ = ["filled_path"]

_FINE_ENOUGH = 1.5  # pixels of the photo between neighbours
_MOST = 1500  # rotations: restoring takes longer with more
_NEIGHBOURS = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3)


def filled_path(kernel: RotationKernel) -> RotationKernel:
    """Return a kernel whose rotations lie about a pixel of its camera's photo apart.

    The mean of all rotations stays where it is. Kernels that are fine enough stay as they are.

    Parameters
    ----------
    kernel : RotationKernel
        On the grid that it was estimated on, for the camera of the photo.

    """
    ratio = float((kernel.steps / grid_steps(kernel.camera)).max())
    if ratio <= _FINE_ENOUGH:
        return kernel
    used = kernel.weights > 0
    if not used.all():
        kernel = replace(kernel, theta=kernel.theta[used], weights=kernel.weights[used])
    offset = kernel.theta[np.argmax(kernel.weights)]
    index = np.rint((kernel.theta - offset) / kernel.steps).astype(np.int64)
    place = {tuple(at): k for k, at in enumerate(index.tolist())}
    pairs = [
        (k, place[other])
        for at, k in place.items()
        for step in _NEIGHBOURS.tolist()
        if any(step) and (other := tuple(np.add(at, step).tolist())) in place
    ]
    if not pairs:
        return kernel
    first, second = np.array(pairs).T
    total = np.bincount(first, kernel.weights[second], len(kernel.weights))
    share = kernel.weights[first] * kernel.weights[second] / total[first]
    count = max(min(int(np.ceil(ratio / 2)), _MOST // len(pairs)), 1)
    along = (np.arange(count) + 0.5) / (2 * count)
    theta = kernel.theta[first] + along[:, None, None] * (
        kernel.theta[second] - kernel.theta[first]
    )
    alone = total == 0
    theta = np.concatenate([theta.reshape(-1, 3), kernel.theta[alone]])
    weights = np.concatenate([np.tile(share / count, count), kernel.weights[alone]])
    steps = kernel.steps / ratio
    filled = RotationKernel(theta, weights / weights.sum(), steps, kernel.camera)
    return _moved(filled, kernel)


def _moved(kernel: RotationKernel, to: RotationKernel) -> RotationKernel:
    """Move a kernel so that its centroid is another's."""
    theta = kernel.theta + (to.centroid - kernel.centroid)
    return RotationKernel(theta, kernel.weights, kernel.steps, kernel.camera)
