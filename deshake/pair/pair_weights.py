"""Weights of two photos, pixel by pixel.

The errors of the kernel limit how well the blurred photo can be explained. g - A f_N has three
parts: the noise of g, the blurred noise of f_N, and the errors of the kernel. The first two are
known; the third is the rest. (g - A f_D)^2 is without the noise of f_N; there the kernel's errors
stand at the edges. So their variance is a share kappa of it, and adds to the noise of g.

The denoised photo f_D is better than f_N where the scene is flat, and worse where the denoiser
removed detail. Where f_N - f_D has the power of noise, the error of f_D is small. Where it has
less power, f_D has noise left; where it has more, f_D lacks detail.

Where both photos show the same scene, A f_D and g agree except for small errors. Where something
moved, or the kernel or the registration is wrong, they disagree. Then the noisy photo is used,
which is at least sharp; but not where it is black, for example where a camera cut off its shadows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter, uniform_filter

from deshake.operators.planes import channels_first
from deshake.operators.strips import bands
from deshake.signal.noise import averaged_over_blur, noise_variance, smoothed

if TYPE_CHECKING:
    from deshake.operators.shake_blur import Filters
    from deshake.pair.denoising import NoisyPhoto

__all__ = ["agreement", "blurred_variance", "denoising_error"]

Image = NDArray[np.float32]


@dataclass(frozen=True)
class _Settings:
    """Thresholds of the weights.

    No record says what the values were tuned on; `bench.py pair` measures them together.

    Parameters
    ----------
    least_share : float
        Least kappa; the largest is `NoisyPhoto.misfit`.
    support : float
        Share of usable pixels nearby: with less, kappa is that of the whole frame.
    left : float
        Least error of the denoised photo, in variances of the noise.
    patch : int
        Px: side of the window that averages the power of f_N - f_D.
    disagreement : float
        Display values: two photos that differ by more do not agree.
    outlying : float
        Sigmas of the difference, if that is larger than the value above.
    agreement_px : float
        Px: sigma of the smoothing of the difference.
    noise : float
        Sigmas of the noise that are tolerated, too: denoising loses faint detail.
    strict : float
        Factor of the tolerance near pixels that clearly disagree.
    spreading : float
        Factor of their share nearby: where the product is 1 or more, the tolerance is strict.
    least_reach : int
        Px: least half side of the windows that count them.
    darkest : float32
        Light: darker pixels count as this bright.

    """

    least_share: float = 0.02
    support: float = 0.2
    left: float = 0.3
    patch: int = 7
    disagreement: float = 0.12
    outlying: float = 3.0
    agreement_px: float = 2.0
    noise: float = 0.3
    strict: float = 0.25
    spreading: float = 4.0
    least_reach: int = 8
    darkest: np.float32 = np.float32(0.003)


_SETTINGS: Final = _Settings()
_BAND = 512  # rows that get their noise at once


def blurred_variance(
    g: Image, Af: Image, noisy: NoisyPhoto, trusted: Image, *, blur: Filters, margin: int
) -> Image:
    """Estimate the variance of the blurred photo by its noise and the kernel's errors.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo.
    Af : (C, h, w) array of float32
        A f_D: the denoised photo, blurred.
    noisy : NoisyPhoto
        The noisy photo, with the blur's margin.
    trusted : (h, w) array of float32
        Weight of each pixel in the comparison of the photos, 0..1.
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
    misfit, left = np.zeros_like(trusted), np.zeros_like(trusted)
    for c in range(count):
        misfit += np.square(planes[c] - Af[c])
        left += np.square(planes[c] - blur.forward(noisy.pixels[c : c + 1])[0])
    misfit *= trusted / np.float32(count)
    left /= np.float32(count)
    twin = _white(noisy.pixels.shape[1:])
    twin *= np.sqrt(noisy.variance())
    left -= np.square(blur.forward(twin[None])[0])
    noise = noise_variance(g, margin)
    left -= noise
    side = 2 * margin + 1
    inner = minimum_filter(trusted, side, mode="constant").astype(np.float32)
    reach = max(margin, 8)
    support = smoothed(inner, reach)
    total = max(float((misfit * inner).sum(dtype=np.float64)), 1e-12)
    everywhere = float((left * inner).sum(dtype=np.float64)) / total
    share = smoothed(left * inner, reach)
    share /= np.maximum(smoothed(misfit * inner, reach), np.float32(1e-12))
    share = np.where(support > _SETTINGS.support, share, np.float32(everywhere))
    misfit *= np.clip(share, _SETTINGS.least_share, noisy.misfit)
    noise += averaged_over_blur(misfit, margin)
    return noise


def denoising_error(noisy: NoisyPhoto) -> Image:
    """Estimate the variance of the error of f_D over that of the noise of f_N, (H, W)."""
    power = np.zeros(noisy.pixels.shape[1:], np.float32)
    for one, other in zip(noisy.pixels, noisy.denoised, strict=True):
        noise = other * np.float32(noisy.slope) + np.float32(noisy.floor)
        power += np.square(one - other) / noise
    power /= np.float32(len(noisy.pixels))
    mean = uniform_filter(power, _SETTINGS.patch)
    error: Image = np.maximum(np.abs(mean - 1), np.float32(_SETTINGS.left))
    return error


def agreement(g: Image, Af: Image, noise: Image, reach: int) -> Image:
    """Measure where the photos agree, (h, w), 0..1.

    The tolerance is smaller near pixels that clearly disagree, such as the outline of an object
    that moved.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo.
    Af : (C, h, w) array of float32
        A f_D: the denoised photo, blurred.
    noise : (h, w) array of float32
        Variance of the noise of f_N.
    reach : int
        Reach of the blur in pixels.

    """
    apart = np.zeros(Af.shape[1:], np.float32)
    for one, other in zip(channels_first(g), Af, strict=True):
        difference = cv2.GaussianBlur(_shown(one) - _shown(other), (0, 0), _SETTINGS.agreement_px)
        apart = np.maximum(apart, np.abs(difference))
    tolerance = max(_SETTINGS.disagreement, _SETTINGS.outlying * float(np.median(apart)) / 0.6745)
    shown = noise / np.clip(Af.mean(0), _SETTINGS.darkest, 1)  # 4 variances of the root's noise
    apart /= np.sqrt(np.float32(tolerance**2) + np.float32(_SETTINGS.noise**2) * shown)
    clearly = 1 - np.exp(-np.square(np.square(apart)))
    near = np.minimum(_SETTINGS.spreading * smoothed(clearly, max(reach, _SETTINGS.least_reach)), 1)
    apart /= 1 - np.float32(1 - _SETTINGS.strict) * near
    agreeing: Image = np.exp(-np.square(np.square(apart)))
    return agreeing


def _shown(light: Image) -> Image:
    """Return the root of the light, which approximates display values."""
    return np.sqrt(np.clip(light, _SETTINGS.darkest, 1))


def _white(shape: tuple[int, int]) -> Image:
    """Make white noise; each band has a stream of its own."""
    out = np.empty(shape, np.float32)
    for number, rows in enumerate(bands(shape[0], _BAND)):
        band = out[rows]
        band[...] = np.random.default_rng(number).standard_normal(band.shape, np.float32)
    return out
