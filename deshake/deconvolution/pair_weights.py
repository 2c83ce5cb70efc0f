"""How far each of two photos is trusted, pixel by pixel.

The blurred one is explained no better than its kernel is known. g - A f_N has three parts: the
noise of g, that of f_N, blurred, and what the kernel gets wrong; the first two are known, and the
third is what is left. As a share kappa of (g - A f_D)^2, where the kernel's errors stand at the
edges and f_N's noise is no more, it makes up the variance of g beside its noise.

f_D, the denoised photo, is a better witness than f_N where the scene is even, a worse one where
detail was taken for noise: where f_N - f_D has the power that noise has, its error is small; where
it has less, noise is left in it, and where more, detail is missing from it.

Where both photos saw the scene, A f_D and g agree but for small errors. Where something moved
between them, or one of them clipped, they do not, and the noisy one is not gone by.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter, uniform_filter

from deshake.deconvolution.noise import noise_variance, smoothed
from deshake.operators.planes import channels_first

if TYPE_CHECKING:
    from deshake.deconvolution.denoising import NoisyPhoto
    from deshake.operators.shake_blur import Filters

__all__ = ["agreement", "blurred_variance", "denoising_error", "padded"]

Image = NDArray[np.float32]

_LEAST_SHARE = 0.02  # kappa
_SUPPORT = 0.2  # share of pixels around that must tell kappa
_LEFT = 0.3  # of the noise's variance, the least error of the denoised photo
_PATCH = 7  # pixels a side over which that is judged
_DISAGREEMENT = 0.12  # in display values, from which on two photos do not agree
_OUTLYING = 3.0  # or so many of its median
_AGREEMENT_PX = 2.0
_DARKEST = np.float32(0.003)
_BAND = 512


def padded(planes: Image, margin: int) -> Image:
    """Continue planes (..., h, w) by their edges to the latent image."""
    around = [(0, 0)] * (planes.ndim - 2) + [(margin, margin)] * 2
    return np.pad(planes, around, mode="edge")


def blurred_variance(
    g: Image, Af: Image, noisy: NoisyPhoto, valid: Image, *, blur: Filters, margin: int
) -> Image:
    """Tell how far off the blurred photo may be: by its noise and by the kernel's errors.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo.
    Af : (C, h, w) array of float32
        A f_D: the denoised photo, blurred.
    noisy : NoisyPhoto
        The noisy photo.
    valid : (h, w) array of float32
        How far it is trusted, 0..1.
    blur : Filters
        The blur A.
    margin : int
        Its reach in pixels.

    Returns
    -------
    (h, w) array of float32
        The variance of g about A f, > 0; it changes slowly.

    """
    planes = channels_first(g)
    count = len(planes)
    misfit, left = np.zeros_like(valid), np.zeros_like(valid)
    for c in range(count):
        misfit += np.square(planes[c] - Af[c])
        left += np.square(planes[c] - blur.forward(padded(noisy.pixels[c : c + 1], margin))[0])
    misfit /= np.float32(count)
    left /= np.float32(count)
    twin = _white(valid.shape)
    twin *= np.sqrt(noisy.variance())
    left -= np.square(blur.forward(padded(twin[None], margin))[0])
    left -= noise_variance(g, margin)
    side = 2 * margin + 1
    inner = minimum_filter(valid, side, mode="constant").astype(np.float32)
    reach = max(margin, 8)
    support = smoothed(inner, reach)
    total = max(float((misfit * inner).sum(dtype=np.float64)), 1e-12)
    everywhere = float((left * inner).sum(dtype=np.float64)) / total
    share = smoothed(left * inner, reach)
    share /= np.maximum(smoothed(misfit * inner, reach), np.float32(1e-12))
    share = np.where(support > _SUPPORT, share, np.float32(everywhere))
    misfit *= np.clip(share, _LEAST_SHARE, noisy.misfit)
    return noise_variance(g, margin, misfit)


def denoising_error(noisy: NoisyPhoto) -> Image:
    """Tell the variance of f_D about the scene, over that of the noise of f_N, (h, w)."""
    power = np.zeros(noisy.pixels.shape[1:], np.float32)
    for one, other in zip(noisy.pixels, noisy.denoised, strict=True):
        noise = other * np.float32(noisy.slope) + np.float32(noisy.floor)
        power += np.square(one - other) / noise
    power /= np.float32(len(noisy.pixels))
    mean = uniform_filter(power, _PATCH)
    error: Image = np.maximum(np.abs(mean - 1), np.float32(_LEFT))
    return error


def agreement(g: Image, Af: Image) -> Image:
    """Tell where the photos agree: the trust v in the noisy one, (h, w), 0..1.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo.
    Af : (C, h, w) array of float32
        A f_D: the denoised photo, blurred.

    """
    apart = np.zeros(Af.shape[1:], np.float32)
    for one, other in zip(channels_first(g), Af, strict=True):
        difference = cv2.GaussianBlur(_shown(one) - _shown(other), (0, 0), _AGREEMENT_PX)
        apart = np.maximum(apart, np.abs(difference))
    tolerance = max(_DISAGREEMENT, _OUTLYING * float(np.median(apart)) / 0.6745)
    apart /= np.float32(tolerance)
    v: Image = np.exp(-np.square(np.square(apart)))
    return v


def _shown(light: Image) -> Image:
    """Return the root of the light, which is about how it is displayed."""
    return np.sqrt(np.clip(light, _DARKEST, 1))


def _white(shape: tuple[int, int]) -> Image:
    """Make white noise; each band has a stream of its own."""
    out = np.empty(shape, np.float32)
    for number, top in enumerate(range(0, shape[0], _BAND)):
        band = out[top : top + _BAND]
        band[...] = np.random.default_rng(number).standard_normal(band.shape, np.float32)
    return out
