"""Shrinkage of gradients by a sparse prior, in closed form except for a few iterations.

Colours and directions are taken together, as vectors: edges then agree among the colours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["lengths", "shrunk"]

Image = NDArray[np.float32]


def lengths(down: Image, across: Image) -> Image:
    """Return the lengths of gradients over both directions and all colours.

    Parameters
    ----------
    down, across : (C, h, w) arrays of float32
        Differences of neighbours.

    Returns
    -------
    (h, w) array of float32

    """
    squares = np.square(down).sum(0)
    squares += np.square(across).sum(0)
    roots: Image = np.sqrt(squares, out=squares)
    return roots


def shrunk(n: Image, threshold: float, p: float) -> Image:
    """Return the share of lengths n that minimising ``threshold u^p + (u - n)^2 / 2`` leaves.

    The share is 0 below some length, and rises above it. There u is the larger root of the
    derivative; a fixed-point iteration from n computes it.

    Parameters
    ----------
    n : (h, w) array of float32
        Lengths, >= 0.
    threshold : float
        The weight of the power, > 0.
    p : float
        The power, 0 < p < 1.

    Returns
    -------
    (h, w) array of float32
        The shares u / n, 0..1.

    """
    t = float(threshold)
    bend = (2 * t * (1 - p)) ** (1 / (2 - p))
    least = np.float32(bend + t * p * bend ** (p - 1))
    out = np.zeros_like(n)
    above = n > least
    some = n[above]
    u = some
    for _ in range(3):
        u = some - np.float32(t * p) * np.maximum(u, np.float32(bend)) ** np.float32(p - 1)
    out[above] = np.maximum(u, 0) / some
    return out
