"""Clipping makes noisy shadows brighter on average; this module corrects the mean.

A file holds no negative light: noise of sigma around a dark mean mu becomes max(x, 0), which is
brighter on average,

    E max(x, 0) = mu Phi(a) + sigma phi(a),    a = mu / sigma.

In display values, which rise steeply in the dark, this is a veil over all shadows. The share of
pixels near a place that are exactly 0 gives a, since P(x <= 0) = Phi(-a). sigma follows from the
mean of the light there. The excess sigma (phi(a) - a Phi(-a)) is subtracted. Noise in whites, which
is clipped at 1, is treated in the same way, upside down.

The neighbours distinguish zeros of noise from zeros of the scene. In noise with a share z of zeros,
2 z (1 - z) of all pairs of neighbours have exactly one zero. In a black object only its rim has
such pairs. Where no pixel is 0, or only objects are black, nothing changes. This is the censored
regression of J. Tobin, "Estimation of relationships for limited dependent variables", Econometrica
26, 1958, https://doi.org/10.2307/1907382, for a mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from deshake.operators.planes import channels_first
from deshake.operators.strips import bands, with_halo

__all__ = ["unclipped_mean"]

Image = NDArray[np.float32]


@dataclass(frozen=True)
class _Settings:
    """Thresholds of the correction. No record says what the values were tuned on.

    Parameters
    ----------
    window : int
        Px: side of a window.
    informative : two floats
        Shares of zeros: windows outside this range do not estimate sigma.
    fewest : float
        Share of all windows: with fewer informative ones, nothing changes.
    least_zeros, most_zeros : float
        Shares of zeros are clipped to them: no mean is below 0.

    """

    window: int = 11
    informative: tuple[float, float] = (0.1, 0.9)
    fewest: float = 0.003
    least_zeros: float = 1e-4
    most_zeros: float = 0.5


_SETTINGS: Final = _Settings()
_BAND = 512  # rows that are processed at once


def unclipped_mean(image: Image) -> Image:
    """Correct the mean of shadows and whites in a photo whose noise was clipped.

    Parameters
    ----------
    image : (h, w) or (h, w, C) array of float32
        The photo as in its file, in linear light, 0..1; before it is resampled.

    Returns
    -------
    (h, w) or (h, w, C) array of float32
        With the local means of the photo before clipping, within 0..1; single pixels may lie
        beyond 0 and 1.

    """
    out = np.array(image, np.float32)
    planes = channels_first(out)
    for c, plane in enumerate(channels_first(image)):
        planes[c] -= _excess(plane)
        planes[c] += _excess(1 - plane)
    return out


class _Window(NamedTuple):
    """Windows around the pixels of a band: mean light, share of zeros, whether noise made these."""

    light: Image
    zeros: Image
    noise: NDArray[np.bool_]


def _excess(plane: Image) -> Image:
    """Return the light that clipping at 0 adds to a plane on average."""
    out = np.zeros(plane.shape, np.float32)
    parts = bands(len(plane), _BAND)
    sigmas = np.concatenate([_sigmas(_windows(plane, band)) for band in parts])
    if len(sigmas) < max(_SETTINGS.fewest * plane.size, 1):
        return out
    sigma = float(np.median(sigmas))
    for band in parts:
        window = _windows(plane, band)
        a = -ndtri(np.clip(window.zeros, _SETTINGS.least_zeros, _SETTINGS.most_zeros))
        excess = sigma * (_density(a) - a * ndtr(-a))
        there = (window.zeros > _SETTINGS.least_zeros) & window.noise
        out[band] = np.where(there, excess, 0)
    return out


def _windows(plane: Image, band: slice) -> _Window:
    """Measure the window around each pixel of a band."""
    around, own = with_halo(band, _SETTINGS.window // 2, len(plane))
    rows = np.ascontiguousarray(plane[around], np.float32)
    zero = rows == 0  # below 0 nothing was clipped
    changes = np.zeros(rows.shape, np.float32)
    changes[:, 1:] = zero[:, 1:] != zero[:, :-1]
    light, zeros, differing = (
        np.asarray(
            cv2.blur(part, (_SETTINGS.window, _SETTINGS.window), borderType=cv2.BORDER_REFLECT)[
                own
            ],
            np.float32,
        )
        for part in (rows, zero.astype(np.float32), changes)
    )
    return _Window(light, zeros, differing >= zeros * (1 - zeros))


def _sigmas(window: _Window) -> NDArray[np.float64]:
    """Return the sigma of noise in every informative window."""
    informative = (
        (window.zeros > _SETTINGS.informative[0])
        & (window.zeros < _SETTINGS.informative[1])
        & window.noise
    )
    a = -ndtri(window.zeros[informative].astype(np.float64))
    sigmas: NDArray[np.float64] = window.light[informative] / (a * ndtr(a) + _density(a))
    return sigmas


def _density(a: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the density of the normal distribution."""
    density: NDArray[np.float64] = np.exp(-np.square(a) / 2) / np.sqrt(2 * np.pi)
    return density
