"""Brightness of a noisy photo against a blurred one: one factor, or a curve for each channel.

Light adds up, so in linear light one factor relates two exposures of one scene. The JPEGs of
cameras are not linear: each exposure has its own contrast curve. A monotone curve for each channel
relates two of them. It is fitted to registered pictures, after so much smoothing that the blur of
one of them no longer matters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError

__all__ = ["ToneCurve", "brightness_ratio", "photometric_scale", "tone_curves"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_MAD = 1.4826  # standard deviation per median absolute deviation of normal noise


@dataclass(frozen=True)
class _FactorSettings:
    """Sizes and thresholds of the one factor.

    No record says what the values were tuned on.

    Parameters
    ----------
    quantiles : tuple of float
        Of each picture, to compare.
    bright : float
        Light: brighter quantiles may be clipped, and are not compared.
    least_pixels : int
        Usable pixels: with fewer, quantiles give the factor.
    smooth_px : float
        Px: sigma before the fit, as wide as the blur of the small pictures may be.
    dark : float
        Share of the pixels, the darkest, that the fit ignores: clipped noise is too bright.
    huber : float
        Sigmas: larger residuals get less weight.
    iterations : int
        Iterations of the reweighted least squares.

    """

    quantiles: tuple[float, ...] = (0.5, 0.7, 0.85, 0.95)
    bright: float = 0.9
    least_pixels: int = 50
    smooth_px: float = 5.0
    dark: float = 0.7
    huber: float = 2.0
    iterations: int = 10


_FACTOR: Final = _FactorSettings()


@dataclass(frozen=True)
class _CurveSettings:
    """Sizes and thresholds of the tone curves.

    No record says what the values were tuned on.

    Parameters
    ----------
    clipped : float
        Light: a brighter pixel counts as clipped.
    bins : int
        Bins of equal count; fewer than 4 pixels a bin are an error.
    ends : two floats
        Quantiles: the ends of the curve, which is straight beyond them.
    knots : int
        Knots of the curve.
    window : int
        Knots that are averaged.
    end_knots : int
        Knots at each end, on a straight line with the slope of the next ones.
    least_slope : float
        Share of the mean slope: a flatter part would lose its detail, and is made as steep.
    most_values : int
        Pixels; of more pixels, every nth is used.

    """

    clipped: float = 0.985
    bins: int = 96
    ends: tuple[float, float] = (0.005, 0.995)
    knots: int = 257
    window: int = 13
    end_knots: int = 12
    least_slope: float = 0.1
    most_values: int = 1_000_000


_CURVES: Final = _CurveSettings()


def brightness_ratio(g: Image, f: Image) -> float:
    """Estimate how many times brighter one picture is than another, registered or not.

    The result is the median ratio of the quantiles below clipping.
    """
    bright, dark = np.quantile(g, _FACTOR.quantiles), np.quantile(f, _FACTOR.quantiles)
    usable = bright < max(_FACTOR.bright, float(bright[0]) * (1 + 1e-6))
    return float(np.median(bright[usable] / np.maximum(dark[usable], 1e-6)))


def photometric_scale(g: Image, f: Image, mask: Mask) -> float:
    """Fit the factor ``a`` of ``g ~ a f`` to two registered pictures in linear light.

    Both are smoothed first, as widely as the blur may move light. Without this, the bright spots of
    the sharp picture, which are spread in the blurred one, would make `a` too small.

    Parameters
    ----------
    g, f : (h, w) arrays of float32
        The blurred and the noisy picture, about 128 pixels wide.
    mask : (h, w) array of bool
        Where both show the scene, below clipping.

    Returns
    -------
    float
        By least squares with Huber's weights, or by quantiles if too few pixels are usable.

    """
    if mask.sum() < _FACTOR.least_pixels:
        return brightness_ratio(g, f)
    smooth_f, smooth_g = (_smoothed(image, mask, _FACTOR.smooth_px)[mask] for image in (f, g))
    x, y = smooth_f.astype(np.float64), smooth_g.astype(np.float64)
    bright = x >= np.quantile(x, _FACTOR.dark)
    x, y = x[bright], y[bright]
    weights = np.ones_like(x)
    scale = 0.0
    for _ in range(_FACTOR.iterations):
        scale = float((weights * x) @ y / max(float((weights * x) @ x), 1e-30))
        residual = np.abs(y - scale * x)
        sigma = _MAD * float(np.median(residual)) + 1e-12
        weights = np.minimum(1, _FACTOR.huber * sigma / np.maximum(residual, 1e-12))
    return scale if scale > 0 else brightness_ratio(g, f)


@dataclass(frozen=True, eq=False)
class ToneCurve:
    """A rising curve ``T`` from the values of one photo to those of another.

    Parameters
    ----------
    knots, values : (n,) arrays of float64
        The curve is linear between its knots, which are evenly spaced, and straight beyond them.

    """

    knots: NDArray[np.float64]
    values: NDArray[np.float64]

    def __call__(self, f: Image) -> Image:
        """Return ``T(f)``, in the shape of `f`."""
        before, after = self._end_slopes
        inside = np.interp(f, self.knots, self.values)
        inside += before * np.minimum(f - self.knots[0], 0) + after * np.maximum(
            f - self.knots[-1], 0
        )
        return np.asarray(inside, np.float32)

    def slope(self, f: Image) -> Image:
        """Return ``T'(f)``, in the shape of `f`."""
        slopes = np.gradient(self.values, self.knots)
        slopes[[0, -1]] = self._end_slopes
        return np.asarray(np.interp(f, self.knots, slopes), np.float32)

    def inverse(self, y: Image) -> Image:
        """Return the `f` of ``T(f) = y``, for a curve whose values rise; not beyond the knots."""
        return np.asarray(np.interp(y, self.values, self.knots), np.float32)

    def matched(self, f_N: Image, f_D: Image) -> Image:
        """Return the noisy photo on the curve: ``T(f_D) + T'(f_D) (f_N - f_D)``.

        Its noise stays without bias; ``T(f_N)`` would bias it where the curve bends.
        """
        return np.asarray(self(f_D) + self.slope(f_D) * (f_N - f_D), np.float32)

    @property
    def _end_slopes(self) -> tuple[float, float]:
        """Slopes before the first knot and after the last."""
        step = float(self.knots[1] - self.knots[0])
        return (
            float(self.values[1] - self.values[0]) / step,
            float(self.values[-1] - self.values[-2]) / step,
        )


def tone_curves(f_D: Image, g: Image, mask: Mask, *, smooth_px: float = 4.0) -> list[ToneCurve]:
    """Fit the curve of each channel that maps the values of one photo to those of another.

    The curves are the isotonic regression of medians in bins of equal count, averaged over a small
    window, and made straight at the ends.

    Parameters
    ----------
    f_D : (h, w) or (h, w, C) array of float32
        The denoised photo, registered. Display values fit better than linear light: their noise is
        more even.
    g : array of that shape
        The blurred photo.
    mask : (h, w) array of bool
        Where both show the scene.
    smooth_px : float
        Sigma of the smoothing of both; 1.5 is enough where `f_D` has the blur of `g`.

    Raises
    ------
    EstimationError
        If too few pixels are neither masked nor clipped, or all are of one value.

    """
    channels = 1 if g.ndim == 2 else g.shape[2]
    curves = []
    for c in range(channels):
        x, y = (
            _smoothed(image if image.ndim == 2 else image[..., c], mask, smooth_px)
            for image in (f_D, g)
        )
        usable = mask & (x < _CURVES.clipped) & (y < _CURVES.clipped)
        step = max(1, int(usable.sum()) // _CURVES.most_values)
        curves.append(_tone_curve(x[usable][::step], y[usable][::step]))
    return curves


def _smoothed(image: Image, mask: Mask, sigma: float) -> Image:
    """Smooth an image, using only the pixels of a mask."""
    light = cv2.GaussianBlur(np.where(mask, image, np.float32(0)), (0, 0), sigma)
    weight = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), sigma)
    return np.asarray(light / np.maximum(weight, 1e-6), np.float32)


def _tone_curve(x: Image, y: Image) -> ToneCurve:
    """Fit one rising curve to pairs of values."""
    from scipy.optimize import isotonic_regression  # noqa: PLC0415 - slow to import, for pairs alone

    if len(x) < 4 * _CURVES.bins:
        raise EstimationError(
            "the two photos have too few pixels in common that are not clipped",
            hint="both must show the same scene, and not be clipped all over",
        )
    order = np.argsort(x, kind="stable")
    bins = np.array_split(order, _CURVES.bins)
    centres = np.array([np.median(x[b]) for b in bins], np.float64)
    medians = np.array([np.median(y[b]) for b in bins], np.float64)
    low, high = np.quantile(x, _CURVES.ends).tolist()
    if high - low < 1e-4 or medians.max() - medians.min() < 1e-6:
        raise EstimationError(
            "the photos have too little contrast to compare their brightness",
            hint="both must show bright and dark parts of the scene",
        )
    rising = isotonic_regression(medians).x
    knots = np.linspace(low, high, _CURVES.knots)
    values = _averaged(np.interp(knots, centres, rising))
    least = _CURVES.least_slope * (values[-1] - values[0]) / (high - low)
    steps = np.maximum(np.diff(values), least * (knots[1] - knots[0]))
    # The ends have few values: they are straight.
    steps[: _CURVES.end_knots] = steps[_CURVES.end_knots : 2 * _CURVES.end_knots].mean()
    steps[-_CURVES.end_knots :] = steps[-2 * _CURVES.end_knots : -_CURVES.end_knots].mean()
    middle = _CURVES.knots // 2
    values = np.concatenate([[0.0], np.cumsum(steps)]) + values[middle] - steps[:middle].sum()
    return ToneCurve(knots, values)


def _averaged(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Average over a window; point reflection continues the values beyond the ends."""
    half = _CURVES.window // 2
    before = 2 * values[0] - values[half:0:-1]
    after = 2 * values[-1] - values[-2 : -half - 2 : -1]
    padded = np.concatenate([before, values, after])
    return np.convolve(padded, np.full(_CURVES.window, 1 / _CURVES.window), "valid")
