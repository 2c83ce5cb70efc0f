"""Measure the sharpness of a photo by its steepest edges, before any estimate.

The measure compares the photo with itself at half the size. An edge as wide as a pixel is equally
steep at both sizes. A wider edge is steeper at half the size, at most twice as steep. The
steepness of a photo along a direction is the 99 % quantile of its differences, without the part
of the noise. The sharpness is the ratio of the two steepnesses: near one for sharp photos, near one
half for blurred ones. It is the least ratio over four directions, because a pan keeps the edges
along its direction sharp. Only tiles in focus count, unless the scale is small.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.blind.tile_choice import chosen
from deshake.signal.noise import noise_level

if TYPE_CHECKING:
    from deshake.signal.pyramid import Pyramid

__all__ = ["looks_sharp", "sharpness"]

Image = NDArray[np.float32]

_S: Final = SETTINGS.sharpness


def looks_sharp(pyramid: Pyramid) -> bool:
    """Return whether a photo is sharp to the pixel, and so was not shaken."""
    scales = range(min(len(_S.sharp), pyramid.coarsest + 1))
    return all(sharpness(pyramid, level) > _S.sharp[level] for level in scales)


def sharpness(pyramid: Pyramid, level: int) -> float:
    """Measure the sharpness of a photo at a scale, about 0.5..1.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    level : int
        The scale.

    Returns
    -------
    float
        Ratio of the steepness to that at half the size; 0 if the photo is flat in a direction, or
        if its noise is as large as its steepest differences.

    """
    return pyramid.kept(("sharpness", level), lambda: _ratio(pyramid, level))


def _ratio(pyramid: Pyramid, level: int) -> float:
    """Return the least ratio of the steepness to that at half the size, over the directions."""
    blocks = [
        np.sqrt(np.clip(block, 0, 1))  # near display values, so that lights do not dominate
        for block in _blocks(pyramid, level)
    ]
    halves = [
        cv2.resize(block, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(np.float32)
        for block in blocks
    ]
    noise = float(np.median([noise_level(block) for block in blocks]))
    pairs = zip(_steepness(blocks, noise), _steepness(halves, noise / 2), strict=True)
    return min(whole / halved if halved > _S.flat else 0.0 for whole, halved in pairs)


def _blocks(pyramid: Pyramid, level: int) -> list[Image]:
    """Return the pixels of the tiles in focus, or all pixels of a small photo."""
    picture = pyramid.at(level).picture
    if min(picture.shape) < _S.tile or picture.size < _S.tiles * _S.tile**2:
        return [picture]
    corners = chosen(pyramid, level, _S.tile, _S.tiles, width=_S.blur)
    return [picture[y : y + _S.tile, x : x + _S.tile] for y, x in corners]


def _steepness(blocks: list[Image], noise: float) -> list[float]:
    """Return the steepness to the right, down, and along both diagonals, without the noise."""
    steps: list[list[Image]] = [[], [], [], []]
    for block in blocks:
        corner = block[:-1, :-1]
        differences = (
            block[:-1, 1:] - corner,
            block[1:, :-1] - corner,
            block[1:, 1:] - corner,
            block[1:, :-1] - block[:-1, 1:],
        )
        for kept, step in zip(steps, differences, strict=True):
            kept.append(np.abs(step).ravel())
    steepest = (float(np.quantile(np.concatenate(step), _S.strongest)) for step in steps)
    return [math.sqrt(max(step**2 - (_S.of_noise * noise) ** 2, 0.0)) for step in steepest]
