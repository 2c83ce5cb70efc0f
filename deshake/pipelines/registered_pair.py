"""A noisy photo registered to a blurred one, its noise, and its tones.

Noise is drawn like the photo's and registered as it was, so that the estimate can take off what
such noise would do to the kernel. In linear light one factor relates two exposures; the JPEGs of
cameras have tone curves of their own, which can be matched channel by channel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.deconvolution.noise import mean_light, noise_model
from deshake.estimation.pair import estimate_pair_kernel
from deshake.estimation.photometric import tone_curves
from deshake.estimation.registration import registered
from deshake.operators.planes import channels_first
from deshake.pipelines.stages import largest_blur, luminance

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from deshake.estimation.pair import PairEstimate
    from deshake.estimation.registration import Registration
    from deshake.io.photo import Photo
    from deshake.pipelines.stages import EstimateOptions

    Progress = Callable[[float, str], None]

__all__ = ["RegisteredPair"]

Image = NDArray[np.float32]

_TWINS: Final = 2
_BAND: Final = 256  # rows that get their noise at once
_CURVE_SMOOTHING_PX: Final = 1.5


@dataclass(frozen=True, eq=False)
class RegisteredPair:
    """A blurred photo and a noisy one registered to it.

    Parameters
    ----------
    blurred, noisy : Photo
        The photos.
    registration : Registration
        How they lie to each other.
    f_reg : (h, w) or (h, w, C) array of float32
        The registered noisy photo, linear light.
    valid : (h, w) array of float32
        Where it is known.
    slopes : array of the shape of f_reg, optional
        Slopes of the tone curves, if it was taken to the tones of the blurred photo.

    """

    blurred: Photo
    noisy: Photo
    registration: Registration
    f_reg: Image
    valid: Image
    slopes: Image | None = None

    def kernel(
        self, options: EstimateOptions, threads: int | None, progress: Progress
    ) -> PairEstimate:
        """Estimate the kernel; raises EstimationError as `estimate_pair_kernel` does."""
        camera = self.registration.camera
        return estimate_pair_kernel(
            self.blurred.pixels,
            self.f_reg,
            self.valid,
            camera,
            uniform=options.uniform,
            blur_size=largest_blur(camera, options),
            noise=self.noise(),
            threads=threads,
            progress=progress,
        )

    def on_curves(self) -> RegisteredPair:
        """Return the noisy photo taken to the tones of the blurred one, channel by channel."""
        g = self.blurred.pixels
        f_N = self.f_reg
        if f_N.ndim != g.ndim:
            f_N, g = luminance(f_N), luminance(g)
        f_D = np.asarray(cv2.GaussianBlur(f_N, (0, 0), _CURVE_SMOOTHING_PX), np.float32)
        curves = tone_curves(f_D, g, (self.valid > 0) & ~self.blurred.clipped)
        matched, slopes = np.empty_like(f_N), np.empty_like(f_N)
        planes = [channels_first(image) for image in (f_N, f_D, matched, slopes)]
        for curve, noisy, smooth, out, slope in zip(curves, *planes, strict=True):
            out[...] = curve.matched(noisy, smooth)
            slope[...] = curve.slope(smooth)
        return replace(self, f_reg=matched, slopes=slopes)

    def noise(self) -> Iterator[Image]:
        """Draw noise like the noisy photo's, and register it as the photo was.

        It is that of the mean of the channels, unless their tone curves differ.
        """
        f_N = self.noisy.pixels
        slope, floor = noise_model(f_N)
        if self.slopes is None:
            count = len(channels_first(f_N))
            return _drawn_noise(mean_light(f_N), slope / count, floor / count, self.registration)
        light = luminance(f_N) if self.slopes.ndim == 2 else f_N
        drawn = _drawn_noise(light, slope, floor, self.registration)
        return (noise * self.slopes for noise in drawn)


def _drawn_noise(
    light: Image, slope: float, floor: float, registration: Registration
) -> Iterator[Image]:
    """Draw and register noise of variance ``slope x + floor`` for light x, a few times."""
    sigma = np.maximum(light, 0)
    sigma *= np.float32(slope)
    sigma += np.float32(floor)
    np.sqrt(sigma, out=sigma)
    for twin in range(_TWINS):
        rng = np.random.default_rng(twin)
        noise = np.empty_like(sigma)
        for top in range(0, len(noise), _BAND):
            band = sigma[top : top + _BAND]
            noise[top : top + _BAND] = rng.standard_normal(band.shape, np.float32) * band
        yield registered(noise, registration)[0]
