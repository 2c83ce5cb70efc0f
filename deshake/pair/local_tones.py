"""What a blurred photo tells of a noisy one place by place: its tones, and how far to go by it.

Cameras lighten shadows, take noise off and crush blacks as they see fit, differently in each part
of a photo. What a curve for the whole frame leaves is straight over a small part of it: there
``g ~ p A f + q``, with a gain p and an offset q for each channel that change no faster than the
blur is wide, so that they pass through A. Where the noisy photo, blurred, even then explains little
of the detail that the blurred one shows, it is not gone by.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import channels_first
from deshake.signal.noise import smoothed

if TYPE_CHECKING:
    Mask = NDArray[np.bool_]

__all__ = ["LocalTones", "local_tones", "local_trust", "wrong_colours"]

Image = NDArray[np.float32]

_LEAST_PX: Final = 8  # reach of the parts
_CONTRAST: Final = np.float32(0.1)  # of the light, below which a part tells no gain of its own
_GAINS: Final = (0.4, 2.5)
_AROUND_PX: Final = 4  # over which detail is compared
_FAINT: Final = (np.float32(3.0), np.float32(1.0))  # median misfits that tell nothing; if strict
_TIMES: Final = 2.0  # the usual share of detail unexplained: there the noisy photo counts little
_HALF: Final = (0.15, 0.5)  # bounds of that
_NOTHING: Final = 1e-9
_DARKEST: Final = np.float32(0.002)


class LocalTones(NamedTuple):
    """Gain and offset of each channel and pixel, (C, h, w)."""

    gain: Image
    offset: Image

    def __call__(self, f: Image) -> Image:
        """Take planes (C, h, w) to the tones of the blurred photo, >= 0."""
        matched: Image = np.maximum(self.gain * f + self.offset, 0)
        return matched


def wrong_colours(g: Image, Af: Image, mask: Mask, reach: int) -> float:
    """Tell how wrong the colours of the noisy photo are, in shares of the true ones' contrast.

    Parameters
    ----------
    g, Af, mask, reach
        As of `local_tones`; what is finer than the blur does not count, nor does lightness.

    """
    planes = channels_first(g)
    if len(planes) == 1:
        return 0.0
    mean = _Mean(mask, reach)
    seen, wrong = (
        np.stack([mean(part) for part in parts])[:, mask]
        for parts in (
            (_tone(y) for y in planes),
            (_tone(y) - _tone(x) for y, x in zip(planes, Af, strict=True)),
        )
    )
    if not seen.size:
        return 0.0
    contrast, error = (float(_colours(part).std()) for part in (seen, wrong))
    return error / max(contrast, 1e-6)


def local_tones(g: Image, Af: Image, mask: Mask, reach: int) -> LocalTones:
    """Fit ``g ~ p A f + q`` about each pixel.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo, linear light.
    Af : (C, h, w) array of float32
        The noisy photo, denoised, registered and blurred, about as bright.
    mask : (h, w) array of bool
        Where both are known, not clipped.
    reach : int
        Of the blur, in pixels.

    Returns
    -------
    LocalTones
        The gain is near 1 where there is little contrast.

    """
    mean = _Mean(mask, reach)
    gain, offset = np.empty_like(Af), np.empty_like(Af)
    for c, (y, x) in enumerate(zip(channels_first(g), Af, strict=True)):
        centre, light = mean(x), mean(y)
        ridge = np.square(_CONTRAST * (np.maximum(light, 0) + _DARKEST))
        variance = np.maximum(mean(x * x) - centre * centre, 0)
        together = mean(x * y) - centre * light
        gain[c] = np.clip((together + ridge) / (variance + ridge), *_GAINS)
        offset[c] = light - gain[c] * centre
    return LocalTones(gain, offset)


def local_trust(g: Image, Af: Image, mask: Mask, reach: int, *, strict: bool = False) -> Image:
    """Tell how far the noisy photo explains what detail the blurred one shows, (h, w), 0..1.

    Parameters
    ----------
    g, Af, mask, reach
        As of `local_tones`, after those have been matched.
    strict : bool
        Whether to ask for as much as the noisy photo explains elsewhere.

    """
    reach = max(reach, _LEAST_PX)
    weight = mask.astype(np.float32)
    shown, lost = np.zeros_like(weight), np.zeros_like(weight)
    for y, x in zip(channels_first(g), Af, strict=True):
        one, other = _detail(y, reach), _detail(x, reach)
        lost += smoothed(np.square(one - other) * weight, _AROUND_PX)
        shown += smoothed(np.square(one) * weight, _AROUND_PX)
    if not mask.any():
        return weight
    share = float(lost[mask].sum(dtype=np.float64)) / max(
        float(shown[mask].sum(dtype=np.float64)), _NOTHING
    )
    half = np.float32(np.clip(_TIMES * share, *_HALF) if strict else _HALF[1])
    shown += _FAINT[strict] * np.median(lost[mask]) + np.float32(_NOTHING)
    lost /= half * shown
    trust: Image = np.exp(-np.square(np.square(lost)))
    return trust


class _Mean:
    """Means of a picture about each pixel, of what lies within a mask."""

    def __init__(self, mask: Mask, reach: int) -> None:
        self.reach = max(reach, _LEAST_PX)
        self.weight = mask.astype(np.float32)
        self.known = np.maximum(smoothed(self.weight, self.reach), np.float32(1e-3))

    def __call__(self, image: Image) -> Image:
        mean: Image = smoothed(image * self.weight, self.reach)
        mean /= self.known
        return mean


def _colours(tones: Image) -> Image:
    """Take the mean over the channels, and that of each channel, off (C, n) values."""
    apart = tones - tones.mean(0)
    return np.asarray(apart - apart.mean(1, keepdims=True), np.float32)


def _tone(light: Image) -> Image:
    """Return the root of the light, which is about how it is displayed."""
    return np.asarray(np.sqrt(np.clip(light, _DARKEST, 1)), np.float32)


def _detail(light: Image, reach: int) -> Image:
    """Return what is finer than the blur and no noise, about as it is displayed."""
    tone = _tone(light)
    fine: Image = smoothed(tone, 1) - smoothed(tone, reach)
    return fine
