"""How sharp a photo is as it is, by its strongest edges.

An edge as wide as a pixel is as steep at half the size of a photo as at the whole; one that is
wider becomes steeper, at most twice as steep. The measure is the ratio of the differences along a
direction, those that 1 % of them exceed, in the direction where it is least, since a pan leaves
sharp what runs along with it: near to one for sharp photos, one half for blurred ones.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["looks_sharp", "sharpness"]

Image = NDArray[np.float32]

_STRONGEST = 0.99  # quantile
_SHARP = 0.72  # shaken photos, by hands or not: 0.52 to 0.69; photos at rest: from 0.74
_FLAT = 1e-6


def sharpness(grey: Image) -> float:
    """Measure how sharp a photo is at the size that it is given, about 0.5..1.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light.

    Returns
    -------
    float
        Ratio of its differences to those at half the size; 0 if it is flat in some direction.

    """
    seen = np.sqrt(np.clip(grey, 0, 1))  # about as it is displayed: lights are not all that counts
    half = cv2.resize(seen, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    pairs = zip(_steepness(seen), _steepness(half.astype(np.float32)), strict=True)
    return min(whole / halved if halved > _FLAT else 0.0 for whole, halved in pairs)


def looks_sharp(grey: Image) -> bool:
    """Tell whether a photo is sharp at the size that it is given."""
    return sharpness(grey) > _SHARP


def _steepness(image: Image) -> list[float]:
    """Steepest differences to the right, down, and along both diagonals."""
    corner = image[:-1, :-1]
    steps = (
        image[:-1, 1:] - corner,
        image[1:, :-1] - corner,
        image[1:, 1:] - corner,
        image[1:, :-1] - image[:-1, 1:],
    )
    return [float(np.quantile(np.abs(step), _STRONGEST)) for step in steps]
