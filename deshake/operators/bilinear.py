"""Bilinear taps: a place between pixels is shared among the four pixels around it.

Weights at fractional displacements are splatted onto a block of pixels; a block is read between its
pixels with the same shares. Blocks are periodic, with lag 0 at the origin. Rasters are not
periodic: places beyond their border are moved to the border.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["bilinear_taps", "splat", "splat_on_raster"]

Image = NDArray[np.float32]


def splat(
    moved: NDArray[np.float64], weights: NDArray[np.float64], block: tuple[int, int]
) -> Image:
    """Splat weights (K,) at displacements (P, K, 2) onto blocks (P, N, M)."""
    count = len(moved)
    place, share = bilinear_taps(moved, block)
    place += (np.arange(count) * block[0] * block[1])[:, None, None]
    spread = share * weights[:, None]
    summed = np.bincount(place.ravel(), spread.ravel(), count * block[0] * block[1])
    return summed.reshape(count, *block).astype(np.float32)


def splat_on_raster(
    places: NDArray[np.float64], weights: NDArray[np.float64], shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Splat weights (K,) at places (K, 2), x and y in pixels, onto a raster (H, W)."""
    height, width = shape
    low = np.floor(places).astype(np.int64)
    part = places - low
    raster = np.zeros(height * width)
    for right in (0, 1):
        for below in (0, 1):
            share = np.abs(1 - right - part[:, 0]) * np.abs(1 - below - part[:, 1])
            x = np.clip(low[:, 0] + right, 0, width - 1)
            y = np.clip(low[:, 1] + below, 0, height - 1)
            raster += np.bincount(y * width + x, share * weights, height * width)
    return raster.reshape(shape)


def bilinear_taps(
    moved: NDArray[np.float64], block: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Places in a periodic block and shares, (P, K, 4), of the bilinear taps of lags (x, y)."""
    low = np.floor(moved)
    a, b = moved[..., 0] - low[..., 0], moved[..., 1] - low[..., 1]
    x, y = low[..., 0].astype(np.int64), low[..., 1].astype(np.int64)
    left, right = x % block[1], (x + 1) % block[1]
    top, bottom = y % block[0] * block[1], (y + 1) % block[0] * block[1]
    index = np.stack([top + left, top + right, bottom + left, bottom + right], -1)
    share = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], -1)
    return index, share
