"""Tone matching of a noisy photo to a blurred one, for pairs that cameras developed.

In linear light one factor relates two exposures. The JPEGs of cameras have contrast curves, white
balances and denoising of their own. To detect this, the noisy photo is blurred and compared with
the blurred one, once with a factor and once with a curve for each channel. If the curves fit much
better, the noisy photo is denoised in display values. Its curves are estimated, and estimated again
after a blur by the kernel. If its colours are still wrong, for example after compression in the
dark, its tones are matched locally (`local_tones`).
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError
from deshake.formats.transfer import Srgb
from deshake.operators.planes import channels_first
from deshake.pair.denoising import NoisyPhoto, denoised_tones
from deshake.pair.local_tones import local_tones, local_trust, wrong_colours
from deshake.pair.photometric import ToneCurve, tone_curves
from deshake.pair.registration import registered
from deshake.run import Run
from deshake.signal.pair_noise import fitted_noise

if TYPE_CHECKING:
    from deshake.operators.shake_blur import ShakeBlur
    from deshake.pair.registration import Registration

__all__ = ["blurred_planes", "camera_pair", "fitted_factor", "needs_curves", "with_tones_of"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class _Settings:
    """Thresholds of the tone matching.

    `better` and `wrong` lie between what was measured on simulated and on real cameras, as said
    below. No record says what the other values were tuned on.

    Parameters
    ----------
    farthest : two floats
        Range of the factor, relative to the registration's; others are clipped to it.
    smooth_px : float
        Px: sigma before curves, where both photos have the same blur.
    broad_px : float
        Px: sigma of the light before the test for curves.
    smoothed_px : float
        Px: sigma before curves of light that is smooth already.
    better : float
        Share of the squared error that curves leave: with more, one factor is used. Cameras
        leave 0.05 to 0.32, linear photos 0.7.
    spread : float32
        Noise near edges over noise in flat areas.
    wrong : float
        Error over contrast of colours: with more, tones are matched locally. Simulated
        cameras have 0.04 to 0.12, real ones 0.27 to 1.1.
    misfit : float
        `NoisyPhoto.misfit` for wrong colours: coarse noise looks like errors of the kernel.
    even : float
        Least variance of the noise, in shares of its mean.

    """

    farthest: tuple[float, float] = (0.8, 1.25)
    smooth_px: float = 1.5
    broad_px: float = 3.0
    smoothed_px: float = 0.5
    better: float = 0.5
    spread: np.float32 = np.float32(1.5)
    wrong: float = 0.2
    misfit: float = 0.15
    even: float = 0.03


_SETTINGS: Final = _Settings()
_STEP: Final = np.float32(1 / 512)  # display values: half the step of a difference quotient
_DISPLAY: Final = Srgb()


def blurred_planes(f: Image, blur: ShakeBlur) -> Image:
    """Blur planes (C, h, w); their edge pixels continue them beyond the frame."""
    around = [(blur.margin, blur.margin)] * 2
    return np.stack([blur.forward(np.pad(plane, around, mode="edge")) for plane in f])


def fitted_factor(g: Image, Af: Image, usable: Mask, blur: ShakeBlur) -> float:
    """Fit the factor that makes the noisy photo, blurred, as bright as the other one."""
    inside = blur.forward(np.pad(usable.astype(np.float32), blur.margin)) > 1 - 1e-3
    inside &= usable
    product = power = 0.0
    for one, other in zip(channels_first(g), Af, strict=True):
        product += float(np.sum(one * other, where=inside, dtype=np.float64))
        power += float(np.sum(other * other, where=inside, dtype=np.float64))
    scale = product / power if power > 0 else 1.0
    return float(np.clip(scale, *_SETTINGS.farthest))


def needs_curves(g: Image, Af: Image, mask: Mask) -> bool:
    """Return whether tone curves relate a pair much better than a factor does.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo.
    Af : (C, h, w) array of float32
        The noisy photo, registered, blurred by the kernel and as bright.
    mask : (h, w) array of bool
        Where both are known, not clipped.

    Raises
    ------
    EstimationError
        As `tone_curves` does.

    """
    side = 2 * ceil(_SETTINGS.broad_px) + 1
    inside = cv2.erode(mask.astype(np.uint8), np.ones((side, side), np.uint8), borderValue=0) > 0
    factor = curved = 0.0
    for plane, other in zip(channels_first(g), Af, strict=True):
        # averaged in linear light, where noise has no bias, then as display values
        x, y = (
            _shown(np.asarray(cv2.GaussianBlur(light, (0, 0), _SETTINGS.broad_px), np.float32))
            for light in (other, plane)
        )
        [curve] = tone_curves(x, y, inside, smooth_px=_SETTINGS.smoothed_px)
        x, y = x[inside], y[inside]
        factor += float(np.square(x - y).sum(dtype=np.float64))
        curved += float(np.square(curve(x) - y).sum(dtype=np.float64))
    return curved < _SETTINGS.better * factor


def camera_pair(
    g: Image,
    Af: Image,
    f_N: Image,
    registration: Registration,
    blur: ShakeBlur,
    *,
    mask: Mask,
    run: Run = Run(),
) -> tuple[NoisyPhoto | None, Image]:
    """Match a noisy photo to the tones of the blurred one, if it has tone curves of its own.

    Parameters are those of `needs_curves` and `with_tones_of`. Return the matched photo, or None,
    and its trust at each pixel, (h, w), 0..1.
    """
    with contextlib.suppress(EstimationError):  # then one factor is used
        if needs_curves(g, Af, mask):
            noisy = with_tones_of(g, f_N, registration, blur, mask, run=run)
            Af = blurred_planes(noisy.denoised, blur)
            strict = noisy.misfit == _SETTINGS.misfit  # its colours were wrong
            return noisy, local_trust(g, Af, mask, blur.margin, strict=strict)
    return None, np.ones(mask.shape, np.float32)


def with_tones_of(
    g: Image,
    f_N: Image,
    registration: Registration,
    blur: ShakeBlur,
    mask: Mask,
    *,
    run: Run = Run(),
) -> NoisyPhoto:
    """Denoise and register a noisy photo, and match it to the tones of the blurred one.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo, linear light.
    f_N : (h', w') or (h', w', C) array of float32
        The noisy photo as in its file.
    registration : Registration
        Its registration.
    blur : ShakeBlur
        The blur in the frame of the registered photo.
    mask : (h, w) array of bool
        Where both photos are known, not clipped.
    run : Run, optional
        Threads to use. The result does not depend on them.

    Returns
    -------
    NoisyPhoto
        In linear light, as bright as the blurred photo.

    Raises
    ------
    EstimationError
        As `tone_curves` does.

    """
    stored = np.stack([_shown(plane) for plane in channels_first(f_N)])
    denoised, sigmas = denoised_tones(stored, run=run)
    noisy, smooth = (
        np.stack([registered(plane, registration)[0] for plane in planes])
        for planes in (stored, denoised)
    )
    del stored, denoised
    shown = [_shown(plane) for plane in channels_first(g)]
    pairs = zip(smooth, shown, strict=True)
    curves = [tone_curves(f_D, tone, mask)[0] for f_D, tone in pairs]
    for c, (curve, tone) in enumerate(zip(curves, shown, strict=True)):
        Af = blurred_planes(_light(curve(smooth[c]))[None], blur)[0]
        before = curve.inverse(_shown(Af))
        curves[c] = tone_curves(before, tone, mask, smooth_px=_SETTINGS.smooth_px)[0]
    variance = np.zeros(g.shape[:2], np.float32)
    for c, (curve, sigma) in enumerate(zip(curves, sigmas, strict=True)):
        steepness = _slope(curve, smooth[c])
        variance += np.square(steepness * sigma)
        noise = steepness * (noisy[c] - smooth[c])
        smooth[c] = _light(curve(smooth[c]))
        noisy[c] = smooth[c] + noise
    variance *= _SETTINGS.spread**2 / np.float32(len(curves))
    misfit = NoisyPhoto.misfit
    Af = blurred_planes(smooth, blur)
    if wrong_colours(g, Af, mask, blur.margin) > _SETTINGS.wrong:
        tones = local_tones(g, Af, mask, blur.margin)
        noisy -= smooth
        noisy *= tones.gain
        smooth = tones(smooth)
        noisy += smooth
        misfit = _SETTINGS.misfit
    slope, floor = fitted_noise(smooth.mean(0)[mask], variance[mask])
    least = _SETTINGS.even * float(variance[mask].mean(dtype=np.float64))
    return NoisyPhoto(noisy, smooth, slope, max(floor, least), misfit)


def _slope(curve: ToneCurve, tone: Image) -> Image:
    """Slope of linear light against display values, for a curve on display values."""
    shown = curve(tone)
    steep = _light(shown + _STEP) - _light(shown - _STEP)
    steep *= curve.slope(tone) / (2 * _STEP)
    return np.asarray(steep, np.float32)


def _shown(light: Image) -> Image:
    return np.asarray(_DISPLAY.from_linear(np.clip(light, 0, 1)), np.float32)


def _light(tone: Image) -> Image:
    return np.asarray(_DISPLAY.to_linear(np.clip(tone, 0, 1)), np.float32)
