"""A noisy photo that is given the tones of a blurred one, for pairs that cameras developed.

In linear light one factor relates two exposures. The JPEGs of cameras have contrast curves, white
balances and denoising of their own. Whether they do is told by how much better than a factor a
curve for each channel takes the noisy photo, blurred, to the blurred one. If so, the noisy photo
is denoised in display values, and its curves are found, once more after it has been blurred by the
kernel. Where its colours are wrong even so, as after compression in the dark, what is coarser than
the blur is taken from the blurred photo.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.deconvolution.denoising import NoisyPhoto, denoised_tones
from deshake.deconvolution.noise import smoothed
from deshake.deconvolution.pair_noise import fitted_noise
from deshake.estimation.photometric import ToneCurve, tone_curves
from deshake.estimation.registration import registered
from deshake.io.transfer import Srgb
from deshake.operators.planes import channels_first

if TYPE_CHECKING:
    from deshake.estimation.registration import Registration
    from deshake.operators.shake_blur import ShakeBlur

__all__ = ["blurred_planes", "fitted_factor", "needs_curves", "with_tones_of"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_FARTHEST: Final = (0.8, 1.25)  # that the factor may be off the one it was brought near by
_SMOOTH_PX: Final = 1.5  # of photos that are blurred alike
_BETTER: Final = 0.25  # share of the mean square that curves leave; noisy linear pairs are above
_SPREAD: Final = np.float32(1.5)  # of noise that is left near edges, over that of flat areas
_EVEN: Final = 0.03  # least variance anywhere, in means: none is known to be free of noise
_LEAST_PX: Final = 8  # reach of what is called coarse
_WRONG: Final = 0.2  # of the contrast of coarse colours; simulated cameras err by 0.06 to 0.14
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
    factor = curved = 0.0
    for plane, other in zip(channels_first(g), Af, strict=True):
        x, y = _shown(other), _shown(plane)
        [curve] = tone_curves(x, y, mask, smooth_px=_SMOOTH_PX)
        x, y = (
            np.asarray(cv2.GaussianBlur(tone, (0, 0), _SMOOTH_PX)[mask], np.float32)
            for tone in (x, y)
        )
        factor += float(np.square(x - y).sum(dtype=np.float64))
        curved += float(np.square(curve(x) - y).sum(dtype=np.float64))
    return curved < _BETTER * factor


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
    tones = [_shown(plane) for plane in channels_first(g)]
    pairs = zip(smooth, tones, strict=True)
    curves = [tone_curves(f_D, tone, mask)[0] for f_D, tone in pairs]
    for c, (curve, tone) in enumerate(zip(curves, tones, strict=True)):
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
    left = _coarse_misfit(g, smooth, blur, mask)
    if left is not None:
        noisy += left
        np.maximum(smooth + left, 0, out=smooth)
    slope, floor = fitted_noise(smooth.mean(0)[mask], variance[mask])
    least = _EVEN * float(variance[mask].mean(dtype=np.float64))
    return NoisyPhoto(noisy, smooth, slope, max(floor, least))


def _coarse_misfit(g: Image, f_D: Image, blur: ShakeBlur, mask: Mask) -> Image | None:
    """Return what is coarse of g - A f_D, (C, h, w), if colours differ by much, else None."""
    reach = max(blur.margin, _LEAST_PX)
    weight = mask.astype(np.float32)
    known = smoothed(weight, reach) + np.float32(1e-3)
    planes = channels_first(g)
    Af = blurred_planes(f_D, blur)
    seen, wrong = (
        np.stack([smoothed(part * weight, reach) / known for part in parts])
        for parts in (
            [_shown(plane) for plane in planes],
            [_shown(one) - _shown(other) for one, other in zip(planes, Af, strict=True)],
        )
    )
    contrast, error = (float(_colours(part)[:, mask].std()) for part in (seen, wrong))
    if error <= _WRONG * contrast or len(planes) == 1:
        return None
    del seen, wrong
    left = [
        smoothed((one - other) * weight, reach) / known
        for one, other in zip(planes, Af, strict=True)
    ]
    return np.stack(left)


def _colours(tones: Image) -> Image:
    """Take the mean over the channels, and that over the frame, off."""
    apart = tones - tones.mean(0)
    return np.asarray(apart - apart.mean((1, 2), keepdims=True), np.float32)


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
