"""Trim an estimated kernel: keep its largest weights, or its connected pieces.

If a photo has few edges, noise adds some weight far away from the camera's path.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import scipy.ndimage

from deshake.blind.settings import SETTINGS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel

__all__ = ["heaviest", "main_piece", "most_of", "strongest", "without_light", "without_strays"]

_S: Final = SETTINGS.trimming


def strongest(kernel: RotationKernel, most: int) -> RotationKernel:
    """Keep at most `most` rotations of a kernel, those with the largest weights."""
    if len(kernel.weights) <= most:
        return kernel
    kept = np.sort(np.argsort(-kernel.weights, kind="stable")[:most])
    return _only(kernel, kept)


def without_light(weights: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Set the smallest weights to zero, as long as they hold less than a share of the sum."""
    order = np.argsort(weights, kind="stable")
    held = np.cumsum(weights[order])
    kept = weights.copy()
    kept[order[held < share * held[-1]]] = 0
    return kept


def heaviest(kernel: RotationKernel, share: float) -> RotationKernel:
    """Discard the smallest weights of a kernel, as long as they hold less than a share.

    The share is of the sum, not of the largest weight. A camera that rests and then moves leaves a
    point and a long faint tail, and the tail may hold most of the light.
    """
    return _only(kernel, without_light(kernel.weights, share) > 0)


def most_of(kernel: RotationKernel) -> RotationKernel:
    """Keep the largest weights, which make up most of a kernel."""
    held = np.cumsum(np.sort(kernel.weights)[::-1])
    return strongest(kernel, int(np.searchsorted(held, _S.most)) + 1)


def without_strays(kernel: RotationKernel) -> RotationKernel:
    """Discard the separate pieces of a kernel that hold little of its weight."""
    piece, held = _pieces(kernel)
    kept = held[piece] >= _S.stray
    if not kept.any():
        return kernel
    return _only(kernel, kept)


def main_piece(kernel: RotationKernel) -> RotationKernel:
    """Keep only the heaviest connected piece of a kernel."""
    piece, held = _pieces(kernel)
    return _only(kernel, piece == np.argmax(held))


def _pieces(kernel: RotationKernel) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the piece of each rotation, and the weight of each piece."""
    place = kernel.indices - kernel.indices.min(0)
    box = np.zeros(place.max(0) + 1, np.uint8)
    box[tuple(place[kernel.weights > 0].T)] = 1
    near = scipy.ndimage.maximum_filter(box, 2 * _S.apart - 1, mode="constant")
    labels, count = scipy.ndimage.label(near, np.ones((3, 3, 3)))
    piece: NDArray[np.int64] = labels[tuple(place.T)]
    held = np.bincount(piece, kernel.weights, count + 1).astype(np.float64)
    return piece, held


def _only(kernel: RotationKernel, kept: NDArray[np.generic]) -> RotationKernel:
    weights = kernel.weights[kept]
    return replace(kernel, theta=kernel.theta[kept], weights=weights / weights.sum())
