"""Measure how the blur of a photo differs by direction, from the power spectrum of its tiles.

Natural scenes are alike at every scale: the power of a scene falls with the frequency by a power
law, and depends on the direction in the same way at every frequency. A blur of covariance
``Sigma`` subtracts ``omega^T Sigma omega`` from the logarithm of the power. So a linear fit of the
logarithm separates scene and blur at a scale where the blur is about a pixel wide. The part of
``Sigma`` that depends on the direction gives the direction of the shake and its width. Goldstein &
Fattal ("Blur-Kernel Estimation from Spectral Irregularities", ECCV 2012) measure the kernel by the
same property.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.blind.tile_choice import chosen, covering
from deshake.signal.noise import noise_level
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from deshake.signal.pyramid import Pyramid

__all__ = ["DirectedBlur", "directed_blur"]

Image = NDArray[np.float32]
Spectrum = NDArray[np.float64]

_S: Final = SETTINGS.spectrum_fit


class DirectedBlur(NamedTuple):
    """The part of a blur that depends on the direction.

    Parameters
    ----------
    strength : float
        Half the difference of the variances along and across the blur, in squared pixels of the
        scale that shows it best; 0 if no scale shows any.
    sigma_px : float
        Standard deviation along the direction, in pixels of the photo.
    direction : float
        Direction in degrees, 0..180, from the x axis towards the y axis (down).
    certain : bool
        Whether a scale has enough tiles for a certain fit.

    """

    strength: float
    sigma_px: float
    direction: float
    certain: bool = False


def directed_blur(pyramid: Pyramid) -> DirectedBlur:
    """Measure the directed blur of a photo at the scale that shows it best."""
    best, most = DirectedBlur(0.0, 0.0, 0.0), 0
    for level in range(max(pyramid.coarsest, 1)):
        spectra, noise = _spectra(pyramid, level)
        most = max(most, len(spectra))
        if not len(spectra):
            continue
        mean, cosine, sine = _fitted(spectra, noise)
        directed = math.hypot(cosine, sine)
        strength = directed * min(1.0, math.sqrt(len(spectra) / _S.enough_tiles))
        sigma = math.sqrt(2 * directed) * RATIO**level
        resolved = mean + directed > _S.resolved and mean > _S.wider and sigma >= _S.narrowest
        if resolved and strength > best.strength:
            best = DirectedBlur(strength, sigma, math.degrees(math.atan2(sine, cosine)) / 2 % 180)
    return best._replace(certain=most >= _S.enough_tiles)


def _spectra(pyramid: Pyramid, level: int) -> tuple[Spectrum, Spectrum]:
    """Return the power spectra of tiles (N, T, T / 2 + 1) and their noise's power (N,)."""
    scale = pyramid.at(level)
    picture = scale.picture
    if min(picture.shape) < _S.tile:
        return np.zeros((0, 0, 0)), np.zeros(0)
    corners = covering(picture.shape, _S.tile)
    if len(corners) * _S.overlap**2 > _S.tiles:
        corners = chosen(pyramid, level, _S.tile, _S.tiles, width=_S.longest_edges)
    else:
        corners = _overlapping(picture.shape)
    window = np.hanning(_S.tile + 2)[1:-1]
    window = np.outer(window, window)
    tiles = []
    for y, x in corners:
        place = np.s_[y : y + _S.tile, x : x + _S.tile]
        if scale.clipped is None or scale.clipped[place].mean() <= _S.most_clipped:
            tiles.append(picture[place])
    if not tiles:
        return np.zeros((0, 0, 0)), np.zeros(0)
    block = np.sqrt(np.clip(np.stack(tiles), 0, 1))  # near display values: lights do not dominate
    centred = block - block.mean((1, 2), keepdims=True)
    power = np.abs(np.fft.rfft2(centred * window)) ** 2 / np.square(window).sum()
    return power, np.array([noise_level(tile) ** 2 for tile in block])


def _overlapping(shape: tuple[int, int]) -> list[tuple[int, int]]:
    """Return the upper left pixels of tiles that overlap."""
    rows, columns = (
        np.linspace(0, n - _S.tile, math.ceil(_S.overlap * n / _S.tile)).astype(int) for n in shape
    )
    return [(int(y), int(x)) for y in rows for x in columns]


def _fitted(spectra: Spectrum, noise: Spectrum) -> tuple[float, float, float]:
    """Return the blur's variance: its mean, and its parts of cos(2 angle) and sin(2 angle)."""
    across, down = np.fft.rfftfreq(_S.tile)[None], np.fft.fftfreq(_S.tile)[:, None]
    frequency = np.hypot(across, down)
    inside = (frequency >= _S.band[0]) & (frequency <= _S.band[1]) & ((across > 0) | (down > 0))
    rho = frequency[inside]
    angle = np.arctan2(down, across + 0 * down)[inside]
    edges = np.maximum((spectra[:, inside] * rho**2).sum(1), 1e-30)  # all tiles count alike
    power = (spectra[:, inside] / edges[:, None]).mean(0)
    power = np.maximum(power - (noise / edges).mean(), _S.least_power * power)
    omega = 2 * np.pi * rho
    design = np.stack(
        [
            np.ones_like(rho),
            -np.log(rho),  # the scene: its power law, and its directions
            *(part(n * angle) for n in (2, 4) for part in (np.cos, np.sin)),
            -(omega**2),  # the blur
            -(omega**2) * np.cos(2 * angle),
            -(omega**2) * np.sin(2 * angle),
        ],
        1,
    )
    solution = np.linalg.lstsq(design, np.log(np.maximum(power, 1e-30)), rcond=None)[0]
    mean, cosine, sine = solution[-3:]
    return float(mean), float(cosine), float(sine)
