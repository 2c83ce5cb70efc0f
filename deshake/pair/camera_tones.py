"""A noisy photo that is given the tones of a blurred one, for pairs that cameras developed.

In linear light one factor relates two exposures. The JPEGs of cameras have contrast curves, white
balances and denoising of their own. Whether they do is told by how much better than a factor a
curve for each channel takes the noisy photo, blurred, to the blurred one. If so, the noisy photo
is denoised in display values, and its curves are found, once more after it has been blurred by the
kernel. Where its colours are wrong even so, as after compression in the dark, it is matched place
by place (`local_tones`).
"""

from __future__ import annotations

import contextlib
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
from deshake.signal.pair_noise import fitted_noise

if TYPE_CHECKING:
    from deshake.operators.shake_blur import ShakeBlur
    from deshake.pair.registration import Registration

__all__ = ["blurred_planes", "camera_pair", "fitted_factor", "needs_curves", "with_tones_of"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_FARTHEST: Final = (0.8, 1.25)  # that the factor may be off the one it was brought near by
_SMOOTH_PX: Final = 1.5  # of photos that are blurred alike
_BROAD_PX: Final = 3.0  # over which light is averaged to see if tones differ
_SMOOTHED_PX: Final = 0.5  # of what is smooth
_BETTER: Final = 0.5  # share of the mean square that curves leave: cameras 0.05 to 0.32, linear 0.7
_SPREAD: Final = np.float32(1.5)  # of noise that is left near edges, over that of flat areas
_WRONG: Final = 0.2  # of the contrast of colours; simulated cameras 0.04 to 0.12, real 0.27 to 1.1
_MISFIT: Final = 0.15  # there, since coarse noise passes for errors of the kernel
_EVEN: Final = 0.03  # least variance anywhere, in means: none is known to be free of noise
_STEP: Final = np.float32(1 / 512)  # for slopes
_DISPLAY: Final = Srgb()


def blurred_planes(f: Image, blur: ShakeBlur) -> Image:
    """Blur planes (C, h, w), which go on beyond the frame by their edges."""
    around = [(blur.margin, blur.margin)] * 2
    return np.stack([blur.forward(np.pad(plane, around, mode="edge")) for plane in f])


def fitted_factor(g: Image, Af: Image, usable: Mask, blur: ShakeBlur) -> float:
    """Fit the factor that makes the noisy photo, blurred, as bright as the other one."""
    seen = blur.forward(np.pad(usable.astype(np.float32), blur.margin)) > 1 - 1e-3
    seen &= usable
    product = power = 0.0
    for one, other in zip(channels_first(g), Af, strict=True):
        product += float(np.sum(one * other, where=seen, dtype=np.float64))
        power += float(np.sum(other * other, where=seen, dtype=np.float64))
    scale = product / power if power > 0 else 1.0
    return float(np.clip(scale, *_FARTHEST))


def needs_curves(g: Image, Af: Image, mask: Mask) -> bool:
    """Tell whether tone curves relate a pair much better than a factor does.

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
    side = 2 * ceil(_BROAD_PX) + 1
    inside = cv2.erode(mask.astype(np.uint8), np.ones((side, side), np.uint8), borderValue=0) > 0
    factor = curved = 0.0
    for plane, other in zip(channels_first(g), Af, strict=True):
        # in light, where noise has no bias, before it is as displayed
        x, y = (
            _shown(np.asarray(cv2.GaussianBlur(light, (0, 0), _BROAD_PX), np.float32))
            for light in (other, plane)
        )
        [curve] = tone_curves(x, y, inside, smooth_px=_SMOOTHED_PX)
        x, y = x[inside], y[inside]
        factor += float(np.square(x - y).sum(dtype=np.float64))
        curved += float(np.square(curve(x) - y).sum(dtype=np.float64))
    return curved < _BETTER * factor


def camera_pair(
    g: Image,
    Af: Image,
    f_N: Image,
    registration: Registration,
    blur: ShakeBlur,
    *,
    mask: Mask,
    threads: int | None = None,
) -> tuple[NoisyPhoto | None, Image]:
    """Take a noisy photo to the tones of the blurred one, if it has tone curves of its own.

    Parameters are those of `needs_curves` and `with_tones_of`. With the photo, or None, comes how
    far to go by it in each place, (h, w), 0..1.
    """
    with contextlib.suppress(EstimationError):  # then one factor has to do
        if needs_curves(g, Af, mask):
            noisy = with_tones_of(g, f_N, registration, blur, mask, threads=threads)
            Af = blurred_planes(noisy.denoised, blur)
            strict = noisy.misfit == _MISFIT  # its colours were wrong
            return noisy, local_trust(g, Af, mask, blur.margin, strict=strict)
    return None, np.ones(mask.shape, np.float32)


def with_tones_of(
    g: Image,
    f_N: Image,
    registration: Registration,
    blur: ShakeBlur,
    mask: Mask,
    *,
    threads: int | None = None,
) -> NoisyPhoto:
    """Denoise and register a noisy photo, and take it to the tones of the blurred one.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo, linear light.
    f_N : (h', w') or (h', w', C) array of float32
        The noisy photo as its file has it.
    registration : Registration
        How it lies.
    blur : ShakeBlur
        The blur, as seen from the registered photo.
    mask : (h, w) array of bool
        Where both photos are known, not clipped.
    threads : int, optional
        Threads to use; by default all processors. The result does not depend on it.

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
    denoised, sigmas = denoised_tones(stored, threads=threads)
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
        curves[c] = tone_curves(before, tone, mask, smooth_px=_SMOOTH_PX)[0]
    variance = np.zeros(g.shape[:2], np.float32)
    for c, (curve, sigma) in enumerate(zip(curves, sigmas, strict=True)):
        steepness = _slope(curve, smooth[c])
        variance += np.square(steepness * sigma)
        noise = steepness * (noisy[c] - smooth[c])
        smooth[c] = _light(curve(smooth[c]))
        noisy[c] = smooth[c] + noise
    variance *= _SPREAD**2 / np.float32(len(curves))
    misfit = NoisyPhoto.misfit
    Af = blurred_planes(smooth, blur)
    if wrong_colours(g, Af, mask, blur.margin) > _WRONG:
        tones = local_tones(g, Af, mask, blur.margin)
        noisy -= smooth
        noisy *= tones.gain
        smooth = tones(smooth)
        noisy += smooth
        misfit = _MISFIT
    slope, floor = fitted_noise(smooth.mean(0)[mask], variance[mask])
    least = _EVEN * float(variance[mask].mean(dtype=np.float64))
    return NoisyPhoto(noisy, smooth, slope, max(floor, least), misfit)


def _slope(curve: ToneCurve, tone: Image) -> Image:
    """Slope of a curve on display values, from these to linear light."""
    shown = curve(tone)
    steep = _light(shown + _STEP) - _light(shown - _STEP)
    steep *= curve.slope(tone) / (2 * _STEP)
    return np.asarray(steep, np.float32)


def _shown(light: Image) -> Image:
    return np.asarray(_DISPLAY.from_linear(np.clip(light, 0, 1)), np.float32)


def _light(tone: Image) -> Image:
    return np.asarray(_DISPLAY.to_linear(np.clip(tone, 0, 1)), np.float32)
