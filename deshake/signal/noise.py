"""Estimates of a photo's noise: one number, or a variance that grows with the light.

The variance as a function of light is measured at a scale that JPEG does not change. Compression
and in-camera denoising remove the finest noise. The usual estimates use the finest noise: on 8-bit
JPEGs they return a tenth of the variance. The noise of means of 2 x 2 pixels remains. `noise_level`
is one of the usual estimates, for reduced copies of a photo.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import channels_first

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = [
    "averaged_over_blur",
    "coarse_noise",
    "mean_light",
    "noise_level",
    "noise_line",
    "noise_model",
    "noise_variance",
    "pair_means",
    "smoothed",
    "tone_noise",
]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_SECOND_DIFFERENCES = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
_MEDIAN = 0.6745  # of the absolute value of a standard normal variable
_STRIPS = 6  # strips of the photo that `noise_level` samples
_MOST_PIXELS = 500_000  # pixels that `noise_level` uses, at most
_BLOCK = 6  # means of 2 x 2 pixels: side of a block
_LEVELS = 8  # levels of brightness
_QUANTILE = 0.01  # share of the blocks of a level, the flattest, that give its noise
_BIAS = 2.5  # true variance over that of the quantile; measured with the stopping rule that uses it
_DARKEST = 0.01  # light that is added before the noise is computed: no model is exact in the dark
_MAD = 1.4826  # standard deviation per median absolute deviation of normal noise
_FINE_PX = 1.2  # px: sigma of the smoothing whose residual is the fine noise
_LEAST_TONE = 0.004  # display values: least noise, about the rounding to 8 bits
_LEAST = 1e-7  # least variance: rounding mid greys to 8 bits gives a few times this


def noise_level(
    picture: Image,
    where: Mask | None = None,
    *,
    tones: Callable[[Image], Image] = np.asarray,
) -> float:
    """Estimate the standard deviation of white noise (Immerkaer 1996, with the median).

    Exactly flat parts, such as a black sky, give no noise and are ignored.

    Parameters
    ----------
    picture : (h, w) array of float32
        The picture. Only six strips of a large one are measured.
    where : (h, w) array of bool, optional
        Pixels to use; by default all.
    tones : callable, keyword-only
        Tone curve that the picture gets before; by default none.

    """
    if where is None and picture.size > _MOST_PIXELS:
        rows = max(_MOST_PIXELS // _STRIPS // picture.shape[1], 3)
        tops = np.linspace(0, picture.shape[0] - rows, _STRIPS).astype(int)
        strips = [tones(picture[t : t + rows]) for t in tops]
        rough = np.concatenate(
            [cv2.filter2D(strip, -1, _SECOND_DIFFERENCES)[1:-1] for strip in strips]
        )
    else:
        rough = cv2.filter2D(tones(picture), -1, _SECOND_DIFFERENCES)
    sizes = np.abs(rough if where is None else rough[where])
    sizes = sizes[sizes > 0]
    return float(np.median(sizes)) / _MEDIAN if sizes.size else 0.0


def tone_noise(plane: Image) -> float:
    """Estimate the standard deviation of noise in display values, where cameras denoised.

    The result is the larger one of the medians of fine and of finest noise.

    Parameters
    ----------
    plane : (h, w) array of float32
        A channel in display values, 0..1.

    Returns
    -------
    float
        At least about the rounding to 8 bits.

    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415 - `inspect` starts faster without it

    fine = plane - gaussian_filter(plane, _FINE_PX)
    down = plane[1:] - plane[:-1]
    finest = (down[:, 1:] - down[:, :-1]) / 2
    deviations = (_MAD * float(np.median(np.abs(part))) for part in (fine, finest) if part.size)
    return max(_LEAST_TONE, *deviations)


def pair_means(image: Image) -> Image:
    """Return means of 2 x 2 pixels of an image (h, w), without an odd last row or column."""
    height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    rows = image[:height:2] + image[1:height:2]
    means: Image = (rows[:, :width:2] + rows[:, 1:width:2]) * np.float32(0.25)
    return means


def noise_model(g: Image) -> tuple[float, float]:
    """Estimate how the variance of noise grows with the light: ``slope x + floor``.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The photo, linear light.

    Returns
    -------
    slope, floor : float
        In squared shares of the clip level; the floor is above 0.

    """
    levels, variances = _by_level(g)
    if not len(levels):
        return 0.0, _LEAST
    return noise_line(levels, variances, _LEAST)


def noise_line(
    levels: NDArray[np.float64], variances: NDArray[np.float64], least: float
) -> tuple[float, float]:
    """Fit the line ``slope x + floor`` to the variances at some levels x.

    The fit minimises relative errors: dark levels count as much as bright ones. Variances and the
    floor below the least count as the least.
    """
    variances = np.maximum(variances, least)
    design = np.stack([levels, np.ones_like(levels)], 1) / variances[:, None]
    slope, floor = _not_negative(design, np.ones_like(levels))
    return slope, max(floor, least)


def _not_negative(design: NDArray[np.float64], target: NDArray[np.float64]) -> tuple[float, float]:
    """Return the two factors, none below 0, that fit the columns of `design` (N, 2) to `target`.

    If a factor of the best fit is negative, the best fit without negative factors has only one
    column. SciPy's nnls does the same, but takes half a second to import.
    """
    both = np.linalg.lstsq(design, target, rcond=None)[0]
    if (both >= 0).all():
        return float(both[0]), float(both[1])
    factors = np.maximum(target @ design / np.maximum(np.square(design).sum(0), 1e-300), 0)
    errors = np.square(target[:, None] - design * factors).sum(0)
    slope, floor = np.where(np.arange(2) == np.argmin(errors), factors, 0)
    return float(slope), float(floor)


def mean_light(g: Image) -> Image:
    """Average the light of all colours of an image (h, w) or (h, w, C), values below 0 as 0."""
    planes = channels_first(g)
    light = np.zeros(g.shape[:2], np.float32)
    for plane in planes:
        light += np.maximum(plane, 0)
    light /= np.float32(len(planes))
    return light


def noise_variance(g: Image, margin: int) -> Image:
    """Estimate the variance of the noise at each place: it grows with the light.

    The light is averaged over the reach of the blur first (`averaged_over_blur`).

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The photo, linear light.
    margin : int
        Reach of the blur in pixels.

    Returns
    -------
    (h, w) array of float32
        In squared shares of the clip level, > 0.

    """
    slope, floor = noise_model(g)
    light = mean_light(g)
    light *= np.float32(slope)
    variance = averaged_over_blur(light, margin)
    variance += np.float32(slope * _DARKEST + floor)
    return variance


def averaged_over_blur(image: Image, margin: int) -> Image:
    """Average an image (h, w) with a tent that reaches as far as a blur, `margin` pixels.

    A weight that changes slowly nearly commutes with the blur. So the errors of a model at bright
    edges do not become detail in the dark beside them.
    """
    return smoothed(image, max(margin // 2, 1))


def coarse_noise(g: Image) -> float:
    """Estimate the variance of white noise by that of means of 2 x 2 pixels, times four.

    In blocks of 12 x 12 pixels the means' diagonal differences, which cancel all slopes, show
    noise and texture. The flattest hundredth of the blocks of each brightness is used. The levels
    of brightness, each an eighth of the photo, have equal weight, since noise grows with the light.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The photo, linear light.

    Returns
    -------
    float
        In squared shares of the clip level; 0 for a photo smaller than a block.

    """
    _, variances = _by_level(g)
    return float(variances.mean()) if len(variances) else 0.0


def _by_level(g: Image) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return up to eight levels of brightness, from dark to bright, and their noise variances."""
    levels: list[NDArray[np.float64]] = []
    variances: list[NDArray[np.float64]] = []
    for channel in channels_first(g):
        means = pair_means(channel)
        rows = means[1:] - means[:-1]
        squares = np.square(rows[:, 1:] - rows[:, :-1])
        down, across = squares.shape[0] // _BLOCK, squares.shape[1] // _BLOCK
        for source, block_means in ((means, levels), (squares, variances)):
            blocks = source[: down * _BLOCK, : across * _BLOCK]
            blocks = blocks.reshape(down, _BLOCK, across, _BLOCK)
            block_means.append(blocks.mean((1, 3), dtype=np.float64).ravel())
    level, variance = np.concatenate(levels), np.concatenate(variances)
    order = np.argsort(level, kind="stable")
    groups = [part for part in np.array_split(order, _LEVELS) if part.size]
    return (
        np.array([level[part].mean() for part in groups]),
        np.array([_BIAS * np.quantile(variance[part], _QUANTILE) for part in groups]),
    )


def smoothed(image: Image, reach: int) -> Image:
    """Average an image (h, w) with a tent that reaches 2 `reach` pixels to each side.

    Beyond the border it has the value of the nearest pixel.
    """
    box = 2 * reach + 1, 2 * reach + 1
    once = cv2.blur(image, box, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.blur(once, box, borderType=cv2.BORDER_REPLICATE), np.float32)
