"""What clipping does to noise, and how to undo it on the mean.

A file holds no negative light: noise of sigma around a dark mean mu comes out as max(x, 0), which
is brighter on the mean,

    E max(x, 0) = mu Phi(a) + sigma phi(a),    a = mu / sigma,

and in display values, which rise steeply in the dark, that is a veil over all shadows. How often a
pixel is exactly 0 near a place tells a, since P(x <= 0) = Phi(-a); sigma follows from the mean of
the light there. What is too much of it, sigma (phi(a) - a Phi(-a)), is taken off. Noise in whites,
clipped at 1, is the same upside down.

That zeros are noise's and not the scene's is told by their neighbours: of noise with a share z of
zeros, 2 z (1 - z) of all neighbours differ in being 0, of a black thing its rim only. Where no
pixel is 0, or only things are black, nothing is changed. It is the censored regression of
J. Tobin, "Estimation of relationships for limited dependent variables", Econometrica 26, 1958,
https://doi.org/10.2307/1907382, for a mean.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from deshake.operators.planes import channels_first

__all__ = ["unclipped_mean"]

Image = NDArray[np.float32]

_WINDOW = 11  # pixels a side
_TELLING = (0.1, 0.9)  # shares of zeros that tell sigma
_FEWEST = 0.003  # share of windows that must tell it
_LEAST_ZEROS, _MOST_ZEROS = 1e-4, 0.5  # a mean below 0 is none
_BAND = 512


def unclipped_mean(image: Image) -> Image:
    """Take shadows and whites of a photo whose noise was clipped to their mean.

    Parameters
    ----------
    image : (h, w) or (h, w, C) array of float32
        The photo as its file has it, in linear light, 0..1; before it is resampled.

    Returns
    -------
    (h, w) or (h, w, C) array of float32
        Of the same local means as the photo would have unclipped, but not beyond 0 and 1; some
        pixels are.

    """
    out = np.array(image, np.float32)
    planes = channels_first(out)
    for c, plane in enumerate(channels_first(image)):
        planes[c] -= _excess(plane)
        planes[c] += _excess(1 - plane)
    return out


class _Window(NamedTuple):
    """Around the pixels of a band: mean light, share of zeros, and whether noise made these."""

    light: Image
    zeros: Image
    noise: NDArray[np.bool_]


def _excess(plane: Image) -> Image:
    """Return what clipping at 0 has added to a plane, on the mean."""
    out = np.zeros(plane.shape, np.float32)
    tops = range(0, len(plane), _BAND)
    found = np.concatenate([_sigmas(_windows(plane, top)) for top in tops])
    if len(found) < max(_FEWEST * plane.size, 1):
        return out
    sigma = float(np.median(found))
    for top in tops:
        window = _windows(plane, top)
        a = -ndtri(np.clip(window.zeros, _LEAST_ZEROS, _MOST_ZEROS))
        excess = sigma * (_density(a) - a * ndtr(-a))
        there = (window.zeros > _LEAST_ZEROS) & window.noise
        out[top : top + _BAND] = np.where(there, excess, 0)
    return out


def _windows(plane: Image, top: int) -> _Window:
    """Look around the pixels of a band."""
    halo = _WINDOW // 2
    first, last = max(top - halo, 0), min(top + _BAND + halo, len(plane))
    rows = np.ascontiguousarray(plane[first:last], np.float32)
    own = slice(top - first, min(top + _BAND, len(plane)) - first)
    zero = rows == 0  # below 0 nothing was clipped
    changes = np.zeros(rows.shape, np.float32)
    changes[:, 1:] = zero[:, 1:] != zero[:, :-1]
    light, zeros, differing = (
        np.asarray(
            cv2.blur(part, (_WINDOW, _WINDOW), borderType=cv2.BORDER_REFLECT)[own], np.float32
        )
        for part in (rows, zero.astype(np.float32), changes)
    )
    return _Window(light, zeros, differing >= zeros * (1 - zeros))


def _sigmas(window: _Window) -> NDArray[np.float64]:
    """Return the sigma of noise in every window that tells it."""
    telling = (window.zeros > _TELLING[0]) & (window.zeros < _TELLING[1]) & window.noise
    a = -ndtri(window.zeros[telling].astype(np.float64))
    sigmas: NDArray[np.float64] = window.light[telling] / (a * ndtr(a) + _density(a))
    return sigmas


def _density(a: NDArray[np.floating]) -> NDArray[np.float64]:
    """Density of the normal distribution."""
    density: NDArray[np.float64] = np.exp(-np.square(a) / 2) / np.sqrt(2 * np.pi)
    return density
