"""Non-local means: a pixel becomes the mean of those near it whose surroundings look alike [1].

    v(x) = sum_d w(x, d) u(x + d) / sum_d w(x, d),
    w(x, d) = exp(-mean |u(y + d) - u(y)|^2 / (2 sigma^2)),

with the mean over all colours and the patch of pixels y around x. For patches that differ by noise
alone the exponent is near -1; for a patch and itself it is 0. So faint detail that resembles
nothing near it keeps a share of itself.

References
----------
.. [1] A. Buades, B. Coll and J.-M. Morel, "A review of image denoising algorithms, with a new one",
   Multiscale Modeling & Simulation 4, 2005, https://doi.org/10.1137/040616024

"""

from __future__ import annotations

from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.operators.strips import bands, in_order, with_halo
from deshake.run import Run

__all__ = ["non_local_means"]

Image = NDArray[np.float32]
Offset = tuple[int, int]

_REACH = 10  # of the search, in pixels
_PATCH = 1  # pixels from a patch's middle to its side
_TILE = 512  # pixels a side that are worked on at once; small ones make threads wait


def non_local_means(u: Image, sigma: float, *, run: Run = Run()) -> Image:
    """Denoise an image whose noise is white and alike everywhere.

    Parameters
    ----------
    u : (C, h, w) array of float32
        The noisy image.
    sigma : float
        Standard deviation of the noise, > 0.
    run : Run, optional
        Threads to use. The result does not depend on them.

    Returns
    -------
    (C, h, w) array of float32

    """
    _, height, width = u.shape
    out = np.empty_like(u)
    halo = _REACH + _PATCH

    def work(tile: tuple[slice, slice]) -> None:
        rows, own_rows = with_halo(tile[0], halo, height)
        columns, own_columns = with_halo(tile[1], halo, width)
        denoised = _denoised(np.ascontiguousarray(u[:, rows, columns]), sigma)
        out[:, *tile] = denoised[:, own_rows, own_columns]

    tiles = list(product(bands(height, _TILE), bands(width, _TILE)))
    for _ in in_order(work, tiles, run):
        pass
    return out


def _offsets() -> list[Offset]:
    """Return half of the offsets in reach, one of each pair (d, -d), without 0."""
    square = range(-_REACH, _REACH + 1)
    disc = [(y, x) for y in square for x in square if x * x + y * y <= _REACH * _REACH]
    return [d for d in disc if d > (0, 0)]


def _denoised(u: Image, sigma: float) -> Image:
    """Denoise a tile; each pair of pixels is compared once and serves both."""
    _, height, width = u.shape
    total, weight = u.copy(), np.ones(u.shape[1:], np.float32)
    for down, across in _offsets():
        left, right = max(-across, 0), max(across, 0)
        here = slice(0, height - down), slice(left, width - right)
        there = slice(down, height), slice(right, width - left)
        if down >= height or left + right >= width:
            continue
        w = _likeness(u[:, *here], u[:, *there], sigma)
        for plane, mean in zip(u, total, strict=True):
            cv2.accumulateProduct(plane[there], w, mean[here])
            cv2.accumulateProduct(plane[here], w, mean[there])
        cv2.accumulate(w, weight[here])
        cv2.accumulate(w, weight[there])
    total /= weight
    return total


def _likeness(a: Image, b: Image, sigma: float) -> Image:
    """Return the weights of pixels (h, w), from the patches around them."""
    squares = np.zeros(a.shape[1:], np.float32)
    for one, other in zip(a, b, strict=True):
        cv2.accumulateSquare(cv2.subtract(one, other), squares)
    side = 2 * _PATCH + 1
    w = cv2.boxFilter(squares, -1, (side, side), borderType=cv2.BORDER_REFLECT)
    weights: Image = np.exp(w * np.float32(-0.5 / (sigma**2 * len(a))))
    return weights
