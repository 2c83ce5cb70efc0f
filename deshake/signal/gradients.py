"""Differences between neighbouring pixels of periodic blocks, and their adjoint.

NumPy works on one long row much faster than on many short ones. So the rows of all blocks are
treated as one, and the pixels at the borders are set once more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["adjoint_differences", "differences", "length_of", "strong"]

Image = NDArray[np.float32]


def differences(blocks: Image) -> tuple[Image, Image]:
    """Differences to the right and to the lower neighbour, of blocks (..., N, M), periodic."""
    across, down = (np.empty(blocks.shape, blocks.dtype) for _ in range(2))
    row, columns = blocks.ravel(), blocks.shape[-1]
    np.subtract(row[1:], row[:-1], out=across.reshape(-1)[:-1])
    np.subtract(row[columns:], row[:-columns], out=down.reshape(-1)[:-columns])
    np.subtract(blocks[..., 0], blocks[..., -1], out=across[..., -1])
    np.subtract(blocks[..., 0, :], blocks[..., -1, :], out=down[..., -1, :])
    return across, down


def adjoint_differences(across: Image, down: Image) -> Image:
    """Adjoint of `differences`: blocks (..., N, M) from two fields of gradients."""
    out: Image = np.negative(across, order="C")
    out -= down
    first = out[..., 0] + across[..., -1]
    row = out.reshape(-1)
    row[1:] += across.ravel()[:-1]
    out[..., 0] = first
    out[..., 1:, :] += down[..., :-1, :]
    out[..., 0, :] += down[..., -1, :]
    return out


def length_of(across: Image, down: Image) -> Image:
    """Return the length of gradients.

    It does not use OpenCV, whose rounding depends on the memory address of its output.
    """
    length: Image = np.sqrt(across * across + down * down)
    return length


def strong(across: Image, down: Image, square: float) -> tuple[Image, Image]:
    """Set to zero, in place, the gradients whose squared length is below `square`; return all."""
    length = across * across
    length += down * down
    keep = (length >= np.float32(square)).astype(across.dtype)
    across *= keep
    down *= keep
    return across, down
