"""A noisy photo registered to a blurred one, its noise, and its tones.

Simulated noise like the photo's is registered in the same way, so that the estimate can subtract
the effect of noise on the kernel. In linear light one factor relates two exposures. The JPEGs of
cameras have tone curves of their own, which `on_curves` matches channel by channel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import channels_first, mean_plane
from deshake.operators.strips import bands
from deshake.pair.kernel_estimate import estimate_pair_kernel
from deshake.pair.photometric import tone_curves
from deshake.pair.registration import registered
from deshake.signal.luminance import luminance
from deshake.signal.noise import noise_model

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from deshake.formats.photo import Photo
    from deshake.pair.kernel_estimate import PairEstimate
    from deshake.pair.registration import Registration
    from deshake.run import Run


__all__ = ["RegisteredPair"]

Image = NDArray[np.float32]

_TWINS: Final = 2  # pictures of simulated noise
_BAND: Final = 256  # rows that get their noise at once
_CURVE_SMOOTHING_PX: Final = 1.5  # px: sigma of the smoothing before tone curves and edges


@dataclass(frozen=True, eq=False)
class RegisteredPair:
    """A blurred photo and a noisy one registered to it.

    Parameters
    ----------
    blurred, noisy : Photo
        The photos.
    registration : Registration
        The registration of the noisy photo.
    f_reg : (h, w) or (h, w, C) array of float32
        The registered noisy photo, linear light.
    valid : (h, w) array of float32
        Where it is known.
    slopes : array of the shape of f_reg, optional
        Slopes of the tone curves, if f_reg has the tones of the blurred photo.

    """

    blurred: Photo
    noisy: Photo
    registration: Registration
    f_reg: Image
    valid: Image
    slopes: Image | None = None

    def kernel(
        self,
        *,
        uniform: bool,
        blur_size: float | None,
        run: Run,
    ) -> PairEstimate:
        """Estimate the kernel; raises EstimationError as `estimate_pair_kernel` does."""
        camera = self.registration.camera
        shares = self.shares()
        g = _mixed(self.blurred.pixels, shares)
        g[self.blurred.clipped] = 1
        return estimate_pair_kernel(
            g,
            _mixed(self.f_reg, shares),
            self.valid,
            camera,
            uniform=uniform,
            blur_size=blur_size,
            noise=self.noise(),
            blurred_noise=self._blurred_noise(shares),
            run=run,
        )

    def shares(self) -> NDArray[np.float64]:
        """Return the weights of the channels in the grey that gives the kernel; their sum is 1.

        The weight is the contrast of the channel's edges in the blurred photo over the noisy
        photo's noise.
        """
        blurred_planes = channels_first(self.blurred.pixels)
        planes = self._stored
        if len(blurred_planes) != len(planes):
            return np.ones(1)
        precisions = []
        for c, (plane, (slope, floor)) in enumerate(zip(planes, self._models, strict=True)):
            fine = cv2.GaussianBlur(blurred_planes[c], (0, 0), _CURVE_SMOOTHING_PX)
            edges = float(np.sqrt(np.square(np.diff(fine)).mean(dtype=np.float64)))
            noise = slope * max(float(plane.mean(dtype=np.float64)), 0.0) + floor
            if self.slopes is not None:
                steep = channels_first(self.slopes)[c]
                noise *= float(np.square(steep).mean(dtype=np.float64))
            precisions.append(edges / noise)
        return np.array(precisions) / sum(precisions)

    def on_curves(self) -> RegisteredPair:
        """Return the noisy photo with the tones of the blurred one, channel by channel."""
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
        """Draw noise like that of the noisy photo's mixed channels, registered like the photo."""
        planes = self._stored
        shares = _shares_of(planes, self.shares())
        if self.slopes is None:
            sigma = _mixed_deviation(planes, shares, self._models)
            for twin in range(_TWINS):
                noise = _drawn(sigma, np.random.default_rng(twin))
                yield registered(noise, self.registration)[0]
            return
        for twin in range(_TWINS):
            rng = np.random.default_rng(twin)
            mixed = np.zeros(self.valid.shape, np.float32)
            for c, (plane, model) in enumerate(zip(planes, self._models, strict=True)):
                drawn = _drawn(np.sqrt(_variance(plane, *model)), rng)
                noise = registered(drawn, self.registration)[0]
                noise *= channels_first(self.slopes)[c]
                mixed += np.float32(shares[c]) * noise
            yield mixed

    def _blurred_noise(self, shares: NDArray[np.float64]) -> Image:
        """Draw noise like that of the blurred photo's mixed channels."""
        planes = channels_first(self.blurred.pixels)
        sigma = _mixed_deviation(planes, _shares_of(planes, shares), _noise_models(planes))
        return _drawn(sigma, np.random.default_rng(_TWINS))

    @cached_property
    def _stored(self) -> Image:
        """The noisy photo's channels as they are compared, (C, h', w')."""
        f_N = self.noisy.pixels
        return channels_first(f_N if f_N.ndim == self.f_reg.ndim else luminance(f_N))

    @cached_property
    def _models(self) -> list[tuple[float, float]]:
        """Slope and floor of each channel's noise."""
        return _noise_models(self._stored)


def _mixed(image: Image, shares: NDArray[np.float64]) -> Image:
    """Mix the channels of an image by their shares; average them if their number differs."""
    planes = channels_first(image)
    if len(planes) != len(shares):
        return mean_plane(planes)
    grey = np.zeros(planes.shape[1:], np.float32)
    for plane, share in zip(planes, shares, strict=True):
        grey += np.float32(share) * plane
    return grey


def _shares_of(planes: Image, shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shares of an image's channels; equal shares if the number of channels differs."""
    count = len(planes)
    return shares if len(shares) == count else np.full(count, 1 / count)


def _noise_models(planes: Image) -> list[tuple[float, float]]:
    """Return slope and floor of the noise of each channel."""
    return [noise_model(np.ascontiguousarray(plane)) for plane in planes]


def _mixed_deviation(
    planes: Image, shares: NDArray[np.float64], models: Sequence[tuple[float, float]]
) -> Image:
    """Return the standard deviation of the noise of mixed channels."""
    variance = np.zeros(planes.shape[1:], np.float32)
    for plane, share, model in zip(planes, shares, models, strict=True):
        variance += np.float32(share**2) * _variance(plane, *model)
    return np.asarray(np.sqrt(variance), np.float32)


def _variance(light: Image, slope: float, floor: float) -> Image:
    """Return the variance of noise, ``slope x + floor`` at the light x."""
    return np.asarray(np.maximum(light, 0) * np.float32(slope) + np.float32(floor), np.float32)


def _drawn(sigma: Image, rng: np.random.Generator) -> Image:
    """Draw noise of some standard deviation."""
    noise = np.empty_like(sigma)
    for rows in bands(len(noise), _BAND):
        band = sigma[rows]
        noise[rows] = rng.standard_normal(band.shape, np.float32) * band
    return noise
