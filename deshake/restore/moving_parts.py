"""Parts of a photo whose blur is not that of the camera: moving people, cars, waves.

The camera's kernel cannot undo their blur. The restored picture does two things there that it does
not do elsewhere: blurred again, it differs from the photo, because the wrong blur has no light at
some frequencies that the photo has; and it is brighter or darker than all of the photo within the
blur's reach, because it rings. Three figures of the surroundings of a pixel measure this, all in
values T(x) = sqrt(x + 0.003), which are nearly those of a display:

    R^2  mean (T(A f) - T(g))^2, without the share of the noise
    C^2  mean (T(g) - mean T(g))^2, the local contrast
    O    mean of how far T(f) leaves the range of T(g)

A logistic function of their logarithms is the share of the photo that is kept. It was fitted to
eight photos with and without a moving object, by the squared errors of photo and result; a good
part that is lost counts twice. No kernel is exact, and tone curves are not known exactly: they
give misfits all over the frame. So a part moves only if its misfit, relative to its contrast, is
also well above that of the rest of the frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.operators.shake_blur import ShakeBlur
from deshake.run import Run
from deshake.signal.luminance import luminance
from deshake.signal.noise import noise_variance
from deshake.signal.pyramid import reduced

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel

__all__ = ["moving_share"]

Image = NDArray[np.float32]


@dataclass(frozen=True)
class _Settings:
    """The tuned constants, with the ranges that they were tried in."""

    extent: float = 24.0
    """px: a wider blur is looked at in a reduced photo; at 12 px narrow rings are lost."""
    reach: float = 0.6
    """Half the side of the surroundings, per extent of the blur."""
    dark: float = 3e-3
    """Light that is added before the root: the darkest tones of a display are nearly linear."""
    fine: float = 0.7
    """px: sigma of the smoothing of both pictures before the misfit."""
    noise: float = 0.4
    """Share of the noise's variance that this smoothing leaves, about."""
    misfit: np.float32 = np.float32(6.14)
    contrast: np.float32 = np.float32(-1.23)
    overshoot: np.float32 = np.float32(2.47)
    """Weights of the logarithms of R, C and O."""
    bias: np.float32 = np.float32(33.0)
    """Constant of the log odds."""
    floors: tuple[float, float, float] = (2e-3, 3e-3, 5e-4)
    """Least R, C and O: below them is nothing that one could see."""
    above: float = 1.5
    """Ratio of R / C to that of the frame at which the odds are even, whatever R is."""
    steepness: np.float32 = np.float32(6.0)
    """Weight of the logarithm of this ratio."""
    gaps: float = 3.0
    """Half the width of gaps in the mask that are filled, in half sides of the surroundings."""


_SETTINGS: Final = _Settings()
_MOST: Final = 8_000_000  # pixels that are looked at: larger photos are reduced
_SEEN: Final = np.float32(0.9)  # share of a pixel's light that comes from within the frame
_LARGEST: Final = np.float32(0.15)  # misfit of a pixel, at most: lamps are not explained
_LEAST_SEEN: Final = np.float32(0.05)  # share of pixels that count; with fewer, R falls
_NEAR_CLIPPED: Final = 0.25  # px per px of the blur's extent, around clipped pixels
_LEAST_REACH: Final = 3  # px: half the side of the surroundings, at least
_CELLS: Final = 4  # cells of the mask in half a side of the surroundings
_NOTHING: Final = 0.01  # share; a pixel that keeps less of the photo is the restored one
_EVERY: Final = 4  # pixels; the typical misfit of the frame is taken from every fourth one


def moving_share(
    g: Image,
    f: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    run: Run = Run(),
) -> Image:
    """Return how much of the photo to keep at each pixel, because the camera did not blur it.

    Parameters
    ----------
    g, f : (h, w) or (h, w, 3) array of float32
        The photo and its restored picture, linear light.
    kernel : RotationKernel
        The blur, in the frame of `f`.
    clipped : (h, w) array of bool, optional
        Clipped pixels of the photo; they and their neighbours do not count.
    run : Run, optional
        Threads to use. The result does not depend on them.

    Returns
    -------
    (h, w) array of float32
        0 where the camera's blur explains the photo, up to 1 where it does not.

    """
    shape = g.shape[:2]
    scale = min(
        _SETTINGS.extent / max(kernel.extent_px(), 1.0), math.sqrt(_MOST / math.prod(shape)), 1.0
    )
    size = [max(round(n * scale), 1) for n in shape]
    light, restored = (reduced(luminance(image), size) for image in (g, f))
    small = kernel.at_size(*light.shape)
    unclipped = np.ones_like(light)
    if clipped is not None and clipped.any():
        unclipped[reduced(clipped.astype(np.float32), size) > 0] = 0
    extent = small.extent_px()
    reach = max(int(_SETTINGS.reach * extent), _LEAST_REACH)
    misfit = _misfit(light, restored, small, unclipped, reach=reach, run=run)
    odds = _log_odds(light, restored, misfit, extent, reach)
    share = _without_gaps(np.reciprocal(1 + np.exp(-odds)), reach)
    whole = np.asarray(cv2.resize(share, shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
    whole[whole < _NOTHING] = 0
    return whole


def _log_odds(g: Image, f: Image, misfit: Image, extent: float, reach: int) -> Image:
    """Return the log odds that a pixel's blur is not the camera's.

    Parameters
    ----------
    g, f : (h, w) arrays of float32
        Light of the photo and of the restored picture.
    misfit : (h, w) array of float32
        R^2.
    extent : float
        Extent of the blur in pixels.
    reach : int
        Half the side of the surroundings, in pixels.

    """
    settings = _SETTINGS
    shown, result = _tones(g), _tones(f)
    even = cv2.GaussianBlur(shown, (0, 0), max(extent / 3, 1.0))
    contrast = _mean(np.square(cv2.GaussianBlur(shown, (0, 0), settings.fine) - even), reach)
    window = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    outside = np.maximum(cv2.erode(shown, window) - result, 0)
    outside += np.maximum(result - cv2.dilate(shown, window), 0)
    outside = _mean(outside, reach)
    least = [np.float32(floor) for floor in settings.floors]
    log_misfit = np.log(np.maximum(misfit, 0) + least[0] ** 2) / 2
    log_contrast = np.log(contrast + least[1] ** 2) / 2
    odds = settings.misfit * log_misfit + settings.contrast * log_contrast
    odds += settings.overshoot * np.log(outside + least[2]) + settings.bias
    ratio = log_misfit - log_contrast
    ratio -= _typical(ratio, np.sqrt(contrast)) + np.float32(np.log(settings.above))
    lower: Image = np.minimum(odds, settings.steepness * ratio)
    return lower


def _without_gaps(share: Image, reach: int) -> Image:
    """Fill the flat parts of an object, which show no blur, and soften the outline.

    The result is smaller: its cells are a few pixels wide.
    """
    cell = max(reach // _CELLS, 1)
    coarse = reduced(share, [max(n // cell, 1) for n in share.shape])
    side = 2 * int(_SETTINGS.gaps * reach / cell) + 1
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    closed = cv2.morphologyEx(coarse, cv2.MORPH_CLOSE, disk)
    return np.asarray(cv2.GaussianBlur(closed, (0, 0), reach / cell / 2), np.float32)


def _misfit(
    g: Image, f: Image, kernel: RotationKernel, unclipped: Image, *, reach: int, run: Run
) -> Image:
    """Return the mean squared misfit around each pixel, R^2."""
    settings = _SETTINGS
    blur = ShakeBlur(kernel, run=run)
    counted = (blur.forward(np.pad(np.ones_like(g), blur.margin)) > _SEEN).astype(np.float32)
    near = 2 * int(_NEAR_CLIPPED * kernel.extent_px()) + 3
    counted *= cv2.erode(unclipped, np.ones((near, near), np.uint8))
    blurred = blur.forward(np.pad(np.clip(f, 0, 1), blur.margin, mode="edge"))
    error = cv2.GaussianBlur(_tones(blurred) - _tones(g), (0, 0), settings.fine)
    np.clip(error, -_LARGEST, _LARGEST, out=error)
    noise = noise_variance(g, blur.margin) / (4 * (np.maximum(g, 0) + np.float32(settings.dark)))
    squares = _mean(counted * (np.square(error) - np.float32(settings.noise) * noise), reach)
    return squares / (_mean(counted, reach) + _LEAST_SEEN)


def _tones(light: Image) -> Image:
    """Return T of linear light."""
    dark = np.float32(_SETTINGS.dark)
    tones: Image = np.sqrt(np.clip(light, 0, 1) + dark)
    return tones


def _typical(values: Image, weights: Image) -> np.float32:
    """Return the weighted median."""
    value, weight = (image[::_EVERY, ::_EVERY].ravel() for image in (values, weights))
    order = np.argsort(value, kind="stable")
    total = np.cumsum(weight[order], dtype=np.float64)
    return np.float32(value[order[np.searchsorted(total, total[-1] / 2)]])


def _mean(image: Image, reach: int) -> Image:
    """Average an image with a tent that reaches 2 `reach` pixels to each side."""
    side = (2 * reach + 1, 2 * reach + 1)
    once = cv2.blur(image, side, borderType=cv2.BORDER_REFLECT)
    return np.asarray(cv2.blur(once, side, borderType=cv2.BORDER_REFLECT), np.float32)
