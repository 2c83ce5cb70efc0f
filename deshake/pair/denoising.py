"""Denoising of the noisy photo of a pair, which guides the deblurring of the other one.

The blurred photo helps to estimate its noise (`pair_noise`). Noise whose variance grows with the
light, slope x + floor, has one variance everywhere in the root of the light [1]; there non-local
means remove it. Where the noisy photo has no pixels, those of the blurred one replace them.

References
----------
.. [1] F. Anscombe, "The transformation of Poisson, binomial and negative-binomial data",
   Biometrika 35, 1948, with the term for readout noise of F. Murtagh, J.-L. Starck and A. Bijaoui,
   "Image restoration with noise suppression using a multiresolution support", Astronomy and
   Astrophysics Supplement 112, 1995.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import channels_first, fitted, image_like
from deshake.operators.strips import bands
from deshake.run import Run
from deshake.signal.noise import tone_noise
from deshake.signal.non_local_means import non_local_means
from deshake.signal.pair_noise import noise_of_pair

if TYPE_CHECKING:
    from collections.abc import Callable

    Resample = Callable[[NDArray[np.float32]], tuple[NDArray[np.float32], NDArray[np.float32]]]

__all__ = ["NoisyPhoto", "denoised_tones", "noisy_photo"]

Image = NDArray[np.float32]


@dataclass(frozen=True)
class _Settings:
    """Strengths of the denoising.

    No record says what the values were tuned on; `bench.py pair` measures them together.

    Parameters
    ----------
    strength : float
        Strength of the non-local means, in standard deviations of the noise; with more,
        faint detail is lost.
    tone_strength : float
        The same for display values, where cameras denoise flat areas.
    steepest : float
        Floor over slope, at most: with less slope the root is nearly linear.

    """

    strength: float = 0.85
    tone_strength: float = 1.2
    steepest: float = 20.0


_SETTINGS: Final = _Settings()
_BAND = 256  # rows that are transformed at once


@dataclass(frozen=True, eq=False)
class NoisyPhoto:
    """The noisy photo, its noise, and the denoised photo.

    Parameters
    ----------
    pixels : (C, H, W) array of float32
        The noisy photo f_N, registered; where it has no pixels, the blurred one.
    denoised : (C, H, W) array of float32
        The same denoised, f_D, >= 0.
    slope, floor : float
        The variance of the noise is ``slope x + floor`` at the light x.
    misfit : float
        The largest share of (g - A f_D)^2 that counts as errors of the kernel.

    """

    pixels: Image
    denoised: Image
    slope: float
    floor: float
    misfit: float = 1.5

    def variance(self) -> Image:
        """Return the variance of the noise, averaged over the colours, (H, W)."""
        variance: Image = self.denoised.mean(0)
        variance *= np.float32(self.slope)
        variance += np.float32(self.floor)
        return variance


def noisy_photo(
    g: Image, f_N: Image, resample: Resample, *, run: Run = Run()
) -> tuple[NoisyPhoto, Image]:
    """Denoise the noisy photo of a pair, then register it: its noise is white in its own frame.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo, linear light.
    f_N : (h', w') or (h', w', C) array of float32
        The noisy photo, as bright as the blurred one, not registered.
    resample : callable
        Resamples it in the blurred photo's frame, or in one that is wider by r pixels on all sides.
        It also returns where the noisy photo has pixels, 1 or 0.
    run : Run, optional
        Threads to use. The result does not depend on them.

    Returns
    -------
    noisy : NoisyPhoto
        Registered.
    valid : (h + 2 r, w + 2 r) array of float32
        Where the noisy photo has pixels.

    Raises
    ------
    ValueError
        If the photos do not fit each other.

    """
    if not (np.isfinite(f_N.min()) and np.isfinite(f_N.max())):
        raise ValueError("a photo's pixels are finite")
    f_reg, valid = resample(f_N)
    if f_reg.shape[2:] != g.shape[2:] or f_reg.shape[:2] != valid.shape:
        raise ValueError(f"a noisy photo of shape {f_reg.shape} does not fit one of {g.shape}")
    pixels = _filled(channels_first(f_reg), g, valid)
    del f_reg
    within = fitted(pixels, g.shape[:2])
    slope, floor = noise_of_pair(image_like(within, g), g, fitted(valid, g.shape[:2]))
    finer = f_N.shape[0] * f_N.shape[1] / (g.shape[0] * g.shape[1])  # pixels for one
    f_D = channels_first(resample(_denoised(f_N, finer * slope, finer * floor, run))[0])
    f_D = np.maximum(_filled(f_D, g, valid), 0)
    return NoisyPhoto(pixels, f_D, slope, floor), valid


def _filled(planes: Image, g: Image, valid: Image) -> Image:
    """Fill the pixels that the noisy photo lacks with those of the blurred one."""
    blurred_planes = fitted(channels_first(g), valid.shape)
    return np.where(valid > 0, planes, blurred_planes).astype(np.float32, copy=False)


def _denoised(f_N: Image, slope: float, floor: float, run: Run) -> Image:
    """Denoise a photo whose noise has the variance ``slope x + floor`` at the light x."""
    filled = channels_first(f_N)
    a = max(slope, floor / _SETTINGS.steepest)
    root = np.empty(filled.shape, np.float32)
    least = floor + 0.375 * a * a
    for rows in bands(filled.shape[1], _BAND):
        part = np.maximum(a * filled[:, rows] + np.float32(least), 0)
        root[:, rows] = np.sqrt(part, out=part) * np.float32(2 / a)
    f_D = non_local_means(root, _SETTINGS.strength, run=run)
    del root
    for rows in bands(f_D.shape[1], _BAND):
        part = np.square(f_D[:, rows] * np.float32(a / 2))
        part -= np.float32(least)
        f_D[:, rows] = np.maximum(part, 0) / np.float32(a)
    return image_like(f_D, f_N)


def denoised_tones(u: Image, *, run: Run = Run()) -> tuple[Image, Image]:
    """Denoise a photo in display values, all channels together, for files of cameras.

    Parameters
    ----------
    u : (C, h, w) array of float32
        The photo before it is resampled, in display values, 0..1.
    run : Run, optional
        Threads to use. The result does not depend on them.

    Returns
    -------
    denoised : (C, h, w) array of float32
        Values of the same kind.
    sigmas : (C,) array of float32
        Standard deviations of the noise, by medians.

    """
    sigmas = np.array([tone_noise(plane) for plane in u], np.float32)
    denoised = non_local_means(u / sigmas[:, None, None], _SETTINGS.tone_strength, run=run)
    denoised *= sigmas[:, None, None]
    return denoised, sigmas
