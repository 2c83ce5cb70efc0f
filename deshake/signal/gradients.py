"""Differences between neighbouring pixels of periodic blocks, and their adjoint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["adjoint_differences", "differences", "length_of", "squared_response", "strong"]

Image = NDArray[np.float32]


def differences(blocks: Image) -> tuple[Image, Image]:
    """Differences to the right and to the lower neighbour, of blocks (..., N, M), periodic."""
    across, down = np.empty_like(blocks), np.empty_like(blocks)
    np.subtract(blocks[..., 1:], blocks[..., :-1], out=across[..., :-1])
    np.subtract(blocks[..., 0], blocks[..., -1], out=across[..., -1])
    np.subtract(blocks[..., 1:, :], blocks[..., :-1, :], out=down[..., :-1, :])
    np.subtract(blocks[..., 0, :], blocks[..., -1, :], out=down[..., -1, :])
    return across, down


def adjoint_differences(across: Image, down: Image) -> Image:
    """Adjoint of `differences`: blocks (..., N, M) from two fields of gradients."""
    out: Image = -across
    out -= down
    out[..., 1:] += across[..., :-1]
    out[..., 0] += across[..., -1]
    out[..., 1:, :] += down[..., :-1, :]
    out[..., 0, :] += down[..., -1, :]
    return out


def length_of(across: Image, down: Image) -> Image:
    """Return the length of gradients.

    It does not use OpenCV, whose rounding depends on the memory address of its output.
    """
    length: Image = np.sqrt(across * across + down * down)
    return length


def squared_response(rows: int, columns: int) -> Image:
    """Squared response of both differences at the frequencies of a real FFT."""
    y = 2 * np.pi * np.arange(rows)[:, None] / rows
    x = 2 * np.pi * np.arange(columns // 2 + 1)[None] / columns
    squared: Image = (4 * np.sin(y / 2) ** 2 + 4 * np.sin(x / 2) ** 2).astype(np.float32)
    return squared


def strong(across: Image, down: Image, square: float) -> tuple[Image, Image]:
    """Set to zero, in place, the gradients whose squared length is below `square`; return all."""
    length = across * across
    length += down * down
    keep = length >= np.float32(square)
    across *= keep
    down *= keep
    return across, down
