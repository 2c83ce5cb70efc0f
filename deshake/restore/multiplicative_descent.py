"""The state of the multiplicative iterations of Richardson-Lucy.

All variants share the blur, the sensor's response, the margin and the extrapolation;
`richardson_lucy` describes them.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from deshake.operators.planes import channels_first
from deshake.operators.strips import bands, in_order
from deshake.restore.total_variation import less_varied, variation_weight
from deshake.signal.noise import pair_means

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.operators.shake_blur import Filters
    from deshake.run import Run

__all__ = ["LEAST_LIGHT", "MultiplicativeDescent", "blurred_back"]

Image = NDArray[np.float32]
T = TypeVar("T")

_SHARPNESS = np.float32(50)  # a of the response
_LINEAR = np.float32(0.75)  # below it the response is a line, to within 1e-7
LEAST_LIGHT = np.float32(1e-6)
"""Light as which darker values count."""

_UNSEEN = np.float32(1e-2)  # A^T 1: latent pixels with no more than this keep their value
_SMALLEST = np.float32(0.25)  # least share of a pixel's light after an extrapolation
_SMOOTHING = 4  # dual steps of the total variation in each iteration
_BAND = 128  # rows that are processed at once


class MultiplicativeDescent:
    """The latent image during the iterations.

    This holds the estimate f and, if it is extrapolated, two more latent images: the point that the
    next iteration starts from, and the change that the last iteration made to its point.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light, 1 where it clips; values below 0 count as 0.
    blur : Filters
        The blur A.
    clipped : (h, w) array of bool, optional
        Clipped pixels. If there are any, the model includes the sensor's response.
    fastest : float
        The longest step of the extrapolation, 0 for none.
    f : (C, H, W) array of float32, optional
        The first estimate, >= 1e-6, which the iterations change; by default `blurred_back`.
    coverage : (H, W) array of float32, optional
        A^T 1, as another descent with this blur has it.
    smooth : bool
        Whether each iteration lowers the total variation.
    run : Run
        Threads to use. The result does not depend on them.

    """

    def __init__(
        self,
        g: Image,
        blur: Filters,
        clipped: NDArray[np.bool_] | None,
        *,
        fastest: float,
        f: Image | None = None,
        coverage: Image | None = None,
        smooth: bool = False,
        run: Run,
    ) -> None:
        self.run = run
        self.like = g
        self.g = channels_first(g)
        self.clipped = clipped if clipped is not None and clipped.any() else None
        self.unclipped = g.size - (0 if self.clipped is None else self.clipped.sum() * len(self.g))
        self.blur = blur
        if coverage is None:
            coverage = blur.adjoint(np.ones((1, *g.shape[:2]), np.float32))[0]
            np.maximum(coverage, _UNSEEN, out=coverage)
        self.coverage = coverage
        self.margin = (len(self.coverage) - len(g)) // 2
        self.weight = variation_weight(g, self.margin) if smooth else None
        self.f = blurred_back(self.g, blur, coverage) if f is None else f
        self.fastest = fastest
        self.point = self.f.copy() if fastest else self.f
        self.change = np.zeros_like(self.f) if fastest or smooth else None
        self.strength = 0.0  # of the last change: its squared norm

    def step(self) -> tuple[float, float]:
        """Iterate once; return the mean squared residuals that the iteration began with.

        The first is that of the pixels, the second that of means of 2 x 2 pixels, times four.
        """
        squared = coarse = along = strength = 0.0
        ratio = self.blur.forward(self.point)
        for c, plane in enumerate(ratio):
            for part in self._each_band(len(plane), partial(self._compare, plane, c)):
                squared += part[0]
                coarse += part[1]
        factor = self.blur.adjoint(ratio)
        del ratio
        for part in self._each_band(self.f.shape[1], partial(self._update, factor)):
            along += part[0]
            strength += part[1]
        if self.change is not None:
            # [1] of `richardson_lucy`: the next point from the last two estimates
            length = np.clip(along / self.strength, 0, self.fastest) if self.strength else 0
            self.strength = strength
            self._each_band(
                self.f.shape[1], partial(self._extrapolate, self.change, np.float32(length))
            )
        count = max(int(self.unclipped), 1)
        return squared / count, coarse / count

    def frame(self) -> Image:
        """Return the estimate within the frame."""
        m = self.margin
        out = np.empty_like(self.like, np.float32, order="C")
        channels_first(out)[...] = self.f[:, m:-m, m:-m]
        return out

    def _compare(self, blurred: Image, c: int, rows: slice) -> tuple[float, float]:
        """Turn the blurred point into the ratio to correct it by; sum the squared residuals."""
        x = blurred[rows]
        g = np.maximum(self.g[c, rows], 0, dtype=np.float32)  # a copy of the photo is large
        np.maximum(x, LEAST_LIGHT, out=x)
        if self.clipped is None:
            residual = g - x
            np.divide(g, x, out=x)
        else:
            high = x > _LINEAR
            over = _SHARPNESS * (x[high] - 1)
            x[high] -= np.logaddexp(0, over) / _SHARPNESS
            residual = np.where(self.clipped[rows], 0, g - x)
            np.divide(g, x, out=x)
            slope = expit(-over)
            x[high] = x[high] * slope + (1 - slope)
        coarse = float(np.sum(np.square(pair_means(residual))))
        fine = float(np.sum(np.square(residual, out=residual)))
        return fine, 16 * coarse  # each mean has four pixels, and a quarter of their variance

    def _update(self, factor: Image, rows: slice) -> tuple[float, float]:
        """Find the change of the point; return its products with the last one and with itself."""
        halo = 0 if self.weight is None else _SMOOTHING + 1
        first = max(rows.start - halo, 0)
        wide = slice(first, rows.stop + halo)
        coverage, point = self.coverage[wide], self.point[:, wide]
        new = np.maximum(factor[:, wide], 0)
        new /= coverage
        np.copyto(new, 1, where=coverage <= _UNSEEN)
        new *= point
        if self.change is None:
            point[...] = new
            return 0.0, 0.0
        if self.weight is not None:
            new = less_varied(new, np.divide(point, coverage), self.weight[wide], _SMOOTHING)
        own = slice(rows.start - first, rows.stop - first)
        change, last = new[:, own] - point[:, own], self.change[:, rows]
        along = float(np.sum(np.multiply(change, last, out=last)))
        last[...] = change
        return along, float(np.sum(np.square(change, out=change)))

    def _extrapolate(self, change: Image, length: np.float32, rows: slice) -> None:
        """Set the next estimate, and extrapolate the next point from the last two estimates."""
        point, f = self.point[:, rows], self.f[:, rows]
        new = point + change[:, rows]
        np.maximum(new, 0, out=new)
        further = new - f
        further *= length
        further += new
        f[...] = new
        new *= _SMALLEST
        np.maximum(further, new, out=point)

    def _each_band(self, height: int, work: Callable[[slice], T]) -> list[T]:
        """Do the work on all rows, band by band; the results are in the order of the bands."""
        return [done for _, done in in_order(work, bands(height, _BAND), self.run)]


def blurred_back(g: Image, blur: Filters, coverage: Image) -> Image:
    """Return A^T g over A^T 1: a first estimate with less noise than the photo.

    Parameters
    ----------
    g : (C, h, w) array of float32
        The blurred photo; values below 0 count as 0.
    blur : Filters
        The blur A.
    coverage : (H, W) array of float32
        A^T 1.

    Returns
    -------
    (C, H, W) array of float32
        The estimate within the frame, >= 1e-6; beyond it, the nearest pixels of the frame.

    """
    m = (len(coverage) - g.shape[1]) // 2
    f = np.empty((len(g), *coverage.shape), np.float32)
    back = blur.adjoint(np.maximum(g, 0, order="C", dtype=np.float32))
    for plane, out in zip(back, f, strict=True):
        inner = (plane / coverage)[m:-m, m:-m]
        np.maximum(np.pad(inner, m, mode="edge"), LEAST_LIGHT, out=out)
    return f
