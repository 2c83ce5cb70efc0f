"""Gram matrices of bilinear taps: ``sum_p S_p C_p S_p'``, the inner loop of kernel estimates.

S_p has four taps for each rotation, so two sparse products replace dense ones over the filters.
The patches of a strip stand side by side in one product, which sums over them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deshake.operators.strips import bands

__all__ = ["patch_grams"]

Image = NDArray[np.float32]

_COLUMNS = 128  # columns that are processed at once
_FULL_BOX = 0.6  # share of used places: above it, a whole box of places costs less


def patch_grams(
    y: NDArray[np.int32],
    x: NDArray[np.int32],
    share: Image,
    correlations: Image,
    local: Image | None,
) -> Image:
    """Sum ``S_p C_p S_p'`` over patches p: the upper triangle, with whole blocks on the diagonal.

    S_p holds the taps (K, 4) at (y, x) with their shares. C_p holds the autocorrelation at the lags
    between their places; local energies, if given, are added on its diagonal.
    """
    from scipy.sparse import csr_array  # noqa: PLC0415 - slow to import, and few need it

    count, size, _ = y.shape
    top, left = y.min(), x.min()
    high, wide = int(y.max() - top) + 1, int(x.max() - left) + 1
    box = (y - top) * wide + x - left
    starts = np.arange(0, 4 * size + 1, 4)
    beside = np.empty((size, count, 4), np.int32)  # a rotation's taps in all patches, in a row
    halves: list[Image] = []
    offset = 0
    for p in range(count):
        used = np.zeros(high * wide, bool)
        used[box[p]] = True
        if used.sum() > _FULL_BOX * used.size:
            used[:] = True
            block = _between_all(correlations[p], high, wide)
        else:
            block = _between(correlations[p], *np.divmod(np.flatnonzero(used), wide))
        if local is not None:
            energy = local[p, top : top + high, left : left + wide]
            block[np.diag_indices(len(block))] += energy.ravel()[used]
        place = (np.cumsum(used, dtype=np.int32) - 1)[box[p]]
        taps = csr_array((share[p].ravel(), place.ravel(), starts), shape=(size, len(block)))
        halves.append(taps @ block)
        beside[:, p] = place + offset
        offset += len(block)
    shares, places = np.moveaxis(share, 0, 1).ravel(), beside.ravel()
    starts *= count
    total = np.zeros((size, size), np.float32)
    for some in bands(size, _COLUMNS):
        right = np.concatenate([half[some].T for half in halves])
        last = some.stop
        end = starts[last]
        both = csr_array((shares[:end], places[:end], starts[: last + 1]), shape=(last, offset))
        total[:last, some] = both @ right
    return total


def _between_all(correlation: Image, high: int, wide: int) -> Image:
    """Read an autocorrelation, lag 0 in the middle, at the lags between a box's places, (n, n)."""
    middle = correlation.shape[0] // 2
    dy, dx = correlation.strides
    spread = np.lib.stride_tricks.as_strided(
        correlation[middle:, middle:], (high, wide, high, wide), (-dy, -dx, dy, dx)
    )
    return np.ascontiguousarray(spread).reshape(high * wide, high * wide)


def _between(correlation: Image, y: NDArray[np.int64], x: NDArray[np.int64]) -> Image:
    """Read an autocorrelation, lag 0 in the middle, at the lags between places (y, x), (n, n)."""
    code = y * correlation.shape[1] + x
    lags: Image = correlation.ravel()[code - code[:, None] + correlation.size // 2]
    return lags
