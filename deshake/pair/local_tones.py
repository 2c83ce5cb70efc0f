"""Local tones of a noisy photo, matched to a blurred one, and the trust in it at each pixel.

Cameras lighten shadows, remove noise and cut off blacks, differently in each part of a photo. After
a curve for the whole frame, the rest is linear over a small part of it: ``g ~ p A f + q``. The gain
p and the offset q of each channel vary no faster than the blur is wide, so that they commute with
A. Where the noisy photo, blurred, still explains little detail of the blurred one, its trust is 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import channels_first
from deshake.signal.noise import smoothed

if TYPE_CHECKING:
    Mask = NDArray[np.bool_]

__all__ = ["LocalTones", "local_tones", "local_trust", "wrong_colours"]

Image = NDArray[np.float32]


@dataclass(frozen=True)
class _Settings:
    """Thresholds of local tones and of the trust.

    No record says what the values were tuned on; `bench.py pair --camera-files` measures them
    together.

    Parameters
    ----------
    least_px : int
        Px: least reach of a part.
    contrast : float32
        Contrast over light: below it, the gain of a part tends to 1.
    gains : two floats
        Range of gains; others are clipped to it.
    around_px : int
        Px: half side of the windows that average squared detail.
    faint : two float32
        Median misfits that are ignored; the second if strict.
    times : float
        Times the usual share of unexplained detail, if strict: there the trust is 1/e.
    half : two floats
        Range of that share; the upper end, if not strict.
    darkest : float32
        Light: least light of the ridge.

    """

    least_px: int = 8
    contrast: np.float32 = np.float32(0.1)
    gains: tuple[float, float] = (0.4, 2.5)
    around_px: int = 4
    faint: tuple[np.float32, np.float32] = (np.float32(3.0), np.float32(1.0))
    times: float = 2.0
    half: tuple[float, float] = (0.15, 0.5)
    darkest: np.float32 = np.float32(0.002)


_SETTINGS: Final = _Settings()
_NOTHING: Final = 1e-9  # avoids division by 0


class LocalTones(NamedTuple):
    """Gain and offset of each channel and pixel, (C, h, w)."""

    gain: Image
    offset: Image

    def __call__(self, f: Image) -> Image:
        """Match planes (C, h, w) to the tones of the blurred photo, >= 0."""
        matched: Image = np.maximum(self.gain * f + self.offset, 0)
        return matched


def wrong_colours(g: Image, Af: Image, mask: Mask, reach: int) -> float:
    """Measure the error of the noisy photo's colours, in shares of the true colours' contrast.

    Parameters
    ----------
    g, Af, mask, reach
        As in `local_tones`. Lightness and detail finer than the blur are ignored.

    """
    planes = channels_first(g)
    if len(planes) == 1:
        return 0.0
    mean = _Mean(mask, reach)
    colours, wrong = (
        np.stack([mean(part) for part in parts])[:, mask]
        for parts in (
            (_tone(y) for y in planes),
            (_tone(y) - _tone(x) for y, x in zip(planes, Af, strict=True)),
        )
    )
    if not colours.size:
        return 0.0
    contrast, error = (float(_colours(part).std()) for part in (colours, wrong))
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
        Reach of the blur, in pixels.

    Returns
    -------
    LocalTones
        The gain is near 1 where there is little contrast.

    """
    mean = _Mean(mask, reach)
    gain, offset = np.empty_like(Af), np.empty_like(Af)
    for c, (y, x) in enumerate(zip(channels_first(g), Af, strict=True)):
        centre, light = mean(x), mean(y)
        ridge = np.square(_SETTINGS.contrast * (np.maximum(light, 0) + _SETTINGS.darkest))
        variance = np.maximum(mean(x * x) - centre * centre, 0)
        together = mean(x * y) - centre * light
        gain[c] = np.clip((together + ridge) / (variance + ridge), *_SETTINGS.gains)
        offset[c] = light - gain[c] * centre
    return LocalTones(gain, offset)


def local_trust(g: Image, Af: Image, mask: Mask, reach: int, *, strict: bool = False) -> Image:
    """Measure how far the noisy photo explains the detail of the blurred one, (h, w), 0..1.

    Parameters
    ----------
    g, Af, mask, reach
        As in `local_tones`, after the tones are matched.
    strict : bool
        Whether the noisy photo must explain as much as it does in most of the frame.

    """
    reach = max(reach, _SETTINGS.least_px)
    weight = mask.astype(np.float32)
    shown, lost = np.zeros_like(weight), np.zeros_like(weight)
    for y, x in zip(channels_first(g), Af, strict=True):
        one, other = _detail(y, reach), _detail(x, reach)
        lost += smoothed(np.square(one - other) * weight, _SETTINGS.around_px)
        shown += smoothed(np.square(one) * weight, _SETTINGS.around_px)
    if not mask.any():
        return weight
    share = float(lost[mask].sum(dtype=np.float64)) / max(
        float(shown[mask].sum(dtype=np.float64)), _NOTHING
    )
    half = np.float32(
        np.clip(_SETTINGS.times * share, *_SETTINGS.half) if strict else _SETTINGS.half[1]
    )
    shown += _SETTINGS.faint[strict] * np.median(lost[mask]) + np.float32(_NOTHING)
    lost /= half * shown
    trust: Image = np.exp(-np.square(np.square(lost)))
    return trust


class _Mean:
    """Means of a picture about each pixel, over the pixels of a mask."""

    def __init__(self, mask: Mask, reach: int) -> None:
        self.reach = max(reach, _SETTINGS.least_px)
        self.weight = mask.astype(np.float32)
        self.known = np.maximum(smoothed(self.weight, self.reach), np.float32(1e-3))

    def __call__(self, image: Image) -> Image:
        mean: Image = smoothed(image * self.weight, self.reach)
        mean /= self.known
        return mean


def _colours(tones: Image) -> Image:
    """Subtract from values (C, n) the mean over the channels, then the mean of each channel."""
    apart = tones - tones.mean(0)
    return np.asarray(apart - apart.mean(1, keepdims=True), np.float32)


def _tone(light: Image) -> Image:
    """Return the root of the light, which approximates display values."""
    return np.asarray(np.sqrt(np.clip(light, _SETTINGS.darkest, 1)), np.float32)


def _detail(light: Image, reach: int) -> Image:
    """Return detail that is finer than the blur and coarser than noise, in about display values."""
    tone = _tone(light)
    fine: Image = smoothed(tone, 1) - smoothed(tone, reach)
    return fine
