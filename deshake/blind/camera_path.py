"""A kernel as the path of a camera: a thin line, without breaks.

A camera moves along a curve. An estimate differs from that curve in two ways. It is too wide,
because of noise, and of edges that it takes for sharper than they are: `thinned` moves the
rotations to the ridge of their density. At a coarse scale it is a row of spikes, and the gaps
between them leave dotted rims in the restored photo: `filled_path` fills the gaps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

__all__ = ["filled_path", "thinned"]

Points = NDArray[np.float64]

_FINE_ENOUGH = 1.5  # px of the photo between neighbours; a finer kernel has no gaps
_MOST = 1500  # rotations; more of them make the restoration slower
_RIDGE_STEPS = 15  # iterations of the mean shift
_ALONG = 1  # dimension of a path
_LIGHT = 1e-6  # share of the kernel's weight; lighter rotations are discarded
_NEIGHBOURS = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
"""Differences of indices, in grid steps, to the neighbours of a rotation and to itself."""


def thinned(kernel: RotationKernel, width: float = 1.0) -> RotationKernel:
    """Move the rotations of a kernel to the ridge of their density; each keeps its weight.

    The method is subspace constrained mean shift (Ozertem & Erdogmus, JMLR 2011). A rotation moves
    to the mean of its neighbours, but only across the path. So no part of the path gets shorter or
    lighter.

    Parameters
    ----------
    kernel : RotationKernel
        A kernel on its grid.
    width : float
        Standard deviation of the neighbourhood, in grid steps.

    """
    used = kernel.weights > 0
    origin = kernel.centroid
    weights = kernel.weights[used]
    points = (kernel.theta[used] - origin) / kernel.steps
    moved = points.copy()
    squares = (points[:, :, None] * points[:, None]).reshape(len(points), -1)
    for _ in range(_RIDGE_STEPS):
        near = weights * np.exp(-0.5 * cdist(moved, points, "sqeuclidean") / width**2)
        near /= near.sum(1, keepdims=True)
        mean = near @ points
        # the Hessian of ln density, scaled: the covariance of the neighbours
        bend = (near @ squares).reshape(-1, 3, 3) - mean[:, :, None] * mean[:, None]
        across = np.linalg.eigh(bend)[1][:, :, : points.shape[1] - _ALONG]
        moved += np.einsum("nij,nkj,nk->ni", across, across, mean - moved)
    return _on_grid(moved, weights, kernel)


def _on_grid(points: Points, weights: Points, kernel: RotationKernel) -> RotationKernel:
    """Distribute rotations (n, 3), in grid steps from the centroid, on the grid trilinearly."""
    low = np.floor(points)
    share = points - low
    corners = np.stack(np.meshgrid(*[(0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    parts = np.where(corners[:, None], share, 1 - share).prod(2) * weights
    places = (low + corners[:, None]).astype(np.int64).reshape(-1, 3)
    indices, which = np.unique(places, axis=0, return_inverse=True)
    held = np.bincount(which.ravel(), parts.ravel(), len(indices))
    kept = held > _LIGHT
    on_grid = RotationKernel.from_indices(
        indices[kept], held[kept] / held[kept].sum(), kernel.steps, kernel.camera
    )
    return _moved(on_grid, kernel)


def filled_path(kernel: RotationKernel) -> RotationKernel:
    """Fill the gaps of a kernel, so that neighbours lie about a pixel of the photo apart.

    The mean of all rotations does not change. A kernel without gaps is returned unchanged.

    Parameters
    ----------
    kernel : RotationKernel
        A kernel for the camera of the photo, on the grid of its estimate.

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
    """Move a kernel to the centroid of another kernel."""
    theta = kernel.theta + (to.centroid - kernel.centroid)
    return RotationKernel(theta, kernel.weights, kernel.steps, kernel.camera)
