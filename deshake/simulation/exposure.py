"""Exposure of a simulated picture: gain, noise and clipping."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deshake.operators.strips import bands

__all__ = ["expose"]

Image = NDArray[np.float32]

_BAND = 256  # rows that get their noise together


def expose(
    pixels: Image,
    *,
    gain: float = 1.0,
    photons: float | None = None,
    noise_sigma: float = 0.0,
    seed: int = 0,
) -> None:
    """Expose a picture in place: gain, shot noise, read noise, and clipping to 0..1.

    Parameters
    ----------
    pixels : (h, w[, C]) array of float32
        Linear light.
    gain : float
        Factor on the light; above 1, lights clip.
    photons : float, optional
        Photons that fill a pixel to the clip level; by default no shot noise.
    noise_sigma : float
        Standard deviation of the read noise, in shares of the clip level.
    seed : int
        The same seed gives the same noise.

    """
    rng = np.random.default_rng([seed, 1])  # another stream than the path's
    for rows in bands(len(pixels), _BAND):
        band = pixels[rows]
        band *= np.float32(gain)
        if photons is not None:
            band[...] = rng.poisson(np.maximum(band, 0).astype(np.float64) * photons) / photons
        if noise_sigma > 0:
            band += rng.normal(0, noise_sigma, band.shape).astype(np.float32)
        np.clip(band, 0, 1, out=band)
