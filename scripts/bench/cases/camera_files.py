"""Render photos as cameras write them, for `bench.cases.rendering`.

A sensor sees one colour at a pixel (the Bayer pattern), with noise. The camera interpolates the
others, smooths away noise, in the colours most of all, applies a tone curve that no file states,
and sharpens. The truth is the sharp scene behind the same tone curve.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from bench.cases.rendering import Way, noisy, to_display

if TYPE_CHECKING:
    from bench.cases.rendering import Image
    from bench.cases.shakes import Case

__all__ = ["CAMERA", "LONG_CURVE", "ToneCurve"]

DENOISED = {"low": 0.01, "mid": 0.02, "high": 0.035}
"""Display values: differences that are smoothed away, for each noise of a case."""
KEPT = 0.3  # share of the fine structure of the light that stays
SHARPENED = 0.63  # share of the fine structure that is added
FINE = 0.004  # display value: finer structure is not sharpened
WHITE = 0.9  # of the largest code of the sensor; the noise of black needs room below it, too
PEDESTAL = 0.02


class ToneCurve(NamedTuple):
    """A camera's tone curve: a gain, the strength of its S, and the black that it cuts off."""

    gain: float
    contrast: float
    black: float

    def develop(self, light: Image) -> Image:
        """Return display values, 0..1, of linear light."""
        exposed = np.maximum(self.gain * light, 0)
        exposed = exposed / (1 + exposed**4) ** 0.25  # the shoulder
        tone = to_display(exposed.astype(np.float32))
        tone = (1 - self.contrast) * tone + self.contrast * tone**2 * (3 - 2 * tone)
        return np.clip((tone - self.black) / (1 - self.black), 0, 1).astype(np.float32)


LONG_CURVE = ToneCurve(1.15, 0.5, 0.015)
"""That of a photo as bright as the scene asks for."""


def photo(light: Image, case: Case) -> Image:
    """Return the display values, 0..1, that a camera makes of linear light, grey or BGR."""
    light = np.clip(light, 0, 1)
    light = noisy(light, case) if light.ndim == 2 else demosaiced(noisy(mosaic(light), case))
    return sharpened(with_curve(denoised(to_display(light), case)))


def with_curve(shown: Image) -> Image:
    """Apply the tone curve to display values."""
    linear = np.linspace(0, 1, 4096, dtype=np.float32) ** 2.4  # fine in the dark
    return np.interp(shown, to_display(linear), LONG_CURVE.develop(linear)).astype(np.float32)


def mosaic(light: Image) -> Image:
    """Keep one colour of BGR at each pixel: red, green / green, blue."""
    out = light[..., 1].copy()
    out[0::2, 0::2] = light[0::2, 0::2, 2]
    out[1::2, 1::2] = light[1::2, 1::2, 0]
    return out


def demosaiced(mosaic: Image) -> Image:
    """Interpolate the colours of a mosaic along its edges."""
    codes = np.rint(65535 * np.clip(WHITE * mosaic + PEDESTAL, 0, 1)).astype(np.uint16)
    colours = cv2.demosaicing(codes, cv2.COLOR_BayerRGGB2BGR_EA)
    return (colours.astype(np.float32) / 65535 - PEDESTAL) / WHITE


def denoised(shown: Image, case: Case) -> Image:
    """Smooth display values, the colours more than the light."""
    least = DENOISED[case.noise]
    if shown.ndim == 2:
        return smoothed(shown, least)
    luma, *chroma = cv2.split(cv2.cvtColor(shown, cv2.COLOR_BGR2YCrCb))
    blurred = [cv2.GaussianBlur(plane, (0, 0), 1.0) for plane in chroma]
    smooth = [cv2.bilateralFilter(plane, 7, 4 * least, 2.0) for plane in blurred]
    return cv2.cvtColor(cv2.merge([smoothed(luma, least), *smooth]), cv2.COLOR_YCrCb2BGR)


def smoothed(plane: Image, least: float) -> Image:
    """Smooth a plane, but for a share of its fine structure."""
    return KEPT * plane + (1 - KEPT) * cv2.bilateralFilter(plane, 5, 2 * least, 1.2)


def sharpened(shown: Image) -> Image:
    """Sharpen display values by an unsharp mask of their light."""
    luma = shown if shown.ndim == 2 else cv2.cvtColor(shown, cv2.COLOR_BGR2GRAY)
    fine = luma - cv2.GaussianBlur(luma, (0, 0), 1.0)
    more = SHARPENED * np.sign(fine) * np.maximum(np.abs(fine) - FINE, 0)
    return np.clip(shown + (more if shown.ndim == 2 else more[..., None]), 0, 1)


CAMERA = Way("camera", LONG_CURVE.develop, photo)
"""Photos as a camera writes them."""
