"""How sharp a photo is as it is, by its strongest edges.

An edge as wide as a pixel is as steep at half the size of a photo as at the whole; one that is
wider becomes steeper, at most twice as steep. The measure is the ratio of the differences along a
direction, those that 1 % of them exceed, in the direction where it is least, since a pan leaves
sharp what runs along with it: near to one for sharp photos, one half for blurred ones. What noise
adds to the differences is taken off.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.estimation.latent_edges import noise_level

__all__ = ["looks_sharp", "looks_soft", "sharpness"]

Image = NDArray[np.float32]

_STRONGEST = 0.99  # quantile
_OF_NOISE = 2.576 * math.sqrt(2)  # that quantile of differences between two pixels of unit noise
_SHARP = 0.67  # real shaken photos: 0.51 to 0.66, one 0.76; sharp ones: from 0.68, one 0.63
_SURELY_SHARP = 0.8
_HARDLY_SHARP = 0.65  # with all kernels mere points there is nothing to gain
_SOFT = ((0.6, 1.2), (_SHARP, 1.7))
"""Sharper than this, and the kernel's standard deviation (px) below that: soft, not shaken. Even
paths of 4 px leave 0.60 and have 1.2, those of 2 px leave 0.68; real shaken photos that come near
have 0.62 and 1.6, 0.66 and 2.1, a simulated shake by 8 px 0.65 and 2.2."""
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
        Ratio of its differences to those at half the size; 0 if it is flat in some direction, or
        as noisy as its edges are steep.

    """
    seen = np.sqrt(np.clip(grey, 0, 1))  # about as it is displayed: lights are not all that counts
    half = cv2.resize(seen, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(np.float32)
    noise = noise_level(seen)
    pairs = zip(_steepness(seen, noise), _steepness(half, noise / 2), strict=True)
    return min(whole / halved if halved > _FLAT else 0.0 for whole, halved in pairs)


def looks_sharp(grey: Image, *, collapsed: float = 1.0) -> bool:
    """Tell whether a photo is sharp at the size that it is given, and thus was not shaken.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, at the size that kernels were estimated at.
    collapsed : float
        Share of the kernels that were estimated from it, 0..1, that are mere points. Unless the
        photo is surely sharp, half of them must be; if all are, less is asked of the photo.

    """
    found = sharpness(grey)
    least = _HARDLY_SHARP if collapsed == 1 else _SHARP if collapsed >= 0.5 else _SURELY_SHARP
    return found > least


def looks_soft(grey: Image, spread_px: float) -> bool:
    """Tell whether a photo is a little soft rather than shaken: its lens, its focus, its making.

    The blur that is found in such a photo is small, while its edges are steeper than a shake
    leaves them: to undo it would sharpen the photo, which nobody asked for.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light.
    spread_px : float
        Standard deviation of the kernel that was estimated from it, in pixels of the whole photo.

    """
    found = sharpness(grey)
    return any(found > least and spread_px < widest for least, widest in _SOFT)


def _steepness(image: Image, noise: float) -> list[float]:
    """Steepest differences to the right, down, and along both diagonals, without the noise's."""
    corner = image[:-1, :-1]
    steps = (
        image[:-1, 1:] - corner,
        image[1:, :-1] - corner,
        image[1:, 1:] - corner,
        image[1:, :-1] - image[:-1, 1:],
    )
    steepest = (float(np.quantile(np.abs(step), _STRONGEST)) for step in steps)
    return [math.sqrt(max(step**2 - (_OF_NOISE * noise) ** 2, 0.0)) for step in steepest]
