"""Bilinear taps: a place between pixels is shared among the four pixels around it.

Splatting adds weights at fractional places to pixels; gathering reads pixels at fractional places
with the same shares. Blocks are periodic, with lag 0 at the origin. Filters have lag 0 in the
middle, and hold all their lags. Rasters are not periodic: places beyond the border move to it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = [
    "BELOW",
    "RIGHT",
    "bilinear_shares",
    "bilinear_taps",
    "filter_taps",
    "gather",
    "gathering_matrix",
    "splat",
    "splat_on_raster",
    "splat_taps",
]

Image = NDArray[np.float32]

_AT_ONCE = 2048  # lags whose taps are computed at once: few stay in the cache

RIGHT, BELOW = np.array([0, 1, 0, 1]), np.array([0, 0, 1, 1])
"""Steps from the pixel at the upper left of a place to its four pixels."""


def bilinear_shares(
    places: NDArray[np.floating], kind: DTypeLike = np.float64
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the upper left pixels of places (..., 2), x and y, and the shares (..., 4)."""
    low = np.floor(places)
    a, b = ((places[..., i] - low[..., i]).astype(kind, copy=False) for i in (0, 1))
    return low, np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], -1)


def bilinear_taps(
    moved: NDArray[np.float64], block: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return places in a periodic block and shares, (P, K, 4), of the taps of lags (x, y)."""
    low, share = bilinear_shares(moved)
    x, y = low[..., 0].astype(np.int64), low[..., 1].astype(np.int64)
    left, right = x % block[1], (x + 1) % block[1]
    top, bottom = y % block[0] * block[1], (y + 1) % block[0] * block[1]
    return np.stack([top + left, top + right, bottom + left, bottom + right], -1), share


def filter_taps(moved: NDArray[np.float64], radius: int) -> tuple[NDArray[np.int32], Image]:
    """Return places in a filter (2r+1, 2r+1) and shares, (P, K, 4), of the taps of lags (x, y)."""
    low, share = bilinear_shares(moved, np.float32)
    x, y = low[..., 0].astype(np.int32), low[..., 1].astype(np.int32)
    n = 2 * radius + 1
    corner = (y + radius) * n + x + radius
    return np.stack([corner, corner + 1, corner + n, corner + n + 1], -1), share


def splat(
    moved: NDArray[np.float64], weights: NDArray[np.float64], block: tuple[int, int]
) -> Image:
    """Splat weights (K,) at displacements (P, K, 2) onto periodic blocks (P, N, M)."""
    place, share = bilinear_taps(moved, block)
    return splat_taps(place, share * weights[:, None], block)


def splat_taps(
    place: NDArray[np.int64], light: NDArray[np.float64], block: tuple[int, int]
) -> Image:
    """Add the light (P, K, 4) of taps to blocks; the call changes `place`."""
    count, size = len(place), block[0] * block[1]
    place += (np.arange(count) * size)[:, None, None]
    summed = np.bincount(place.ravel(), light.ravel(), count * size)
    return summed.reshape(count, *block).astype(np.float32)


def splat_on_raster(
    places: NDArray[np.float64], weights: NDArray[np.float64], shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Splat weights (K,) at places (K, 2), x and y in pixels, onto a raster (H, W)."""
    height, width = shape
    low, share = bilinear_shares(places)
    left, top = low.astype(np.int64).T
    x = np.clip(left[:, None] + RIGHT, 0, width - 1)
    y = np.clip(top[:, None] + BELOW, 0, height - 1)
    light = share * weights[:, None]
    raster: NDArray[np.float64] = np.zeros(height * width)
    raster += np.bincount((y * width + x).ravel(), light.ravel(), height * width)
    return raster.reshape(shape)


def gather(
    blocks: Image, place: NDArray[np.integer], share: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Read blocks (P, N, M) at taps (P, K, 4), and sum over the blocks: (K,)."""
    total = np.zeros(place.shape[1])
    for flat, at, part in zip(blocks.reshape(len(blocks), -1), place, share, strict=True):
        total += np.einsum("ka,ka->k", flat[at], part)
    return total


def gathering_matrix(moved: NDArray[np.float64], block: tuple[int, int]) -> csr_array:
    """Return the matrix (K, P N M) of `gather` for periodic blocks, for repeated use."""
    from scipy.sparse import csr_array  # noqa: PLC0415 - `inspect` starts faster without it

    count, size = len(moved), block[0] * block[1]
    lags = moved.shape[1]
    first = (np.arange(count) * size)[:, None, None]
    columns = np.empty((lags, count, 4), np.int32)
    data = np.empty(columns.shape, np.float32)
    for start in range(0, lags, _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        place, share = bilinear_taps(moved[:, part], block)
        place += first
        columns[part], data[part] = np.swapaxes(place, 0, 1), np.swapaxes(share, 0, 1)
    rows = np.arange(lags + 1, dtype=np.int32) * (4 * count)
    return csr_array((data.ravel(), columns.ravel(), rows), (lags, count * size))
