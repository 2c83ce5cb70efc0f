"""Richardson-Lucy deconvolution with a known rotation kernel, Eq. (11).

    f <- f . A^T(g / A f) / A^T 1

A is the filter flow of the kernel, on a latent image that reaches beyond the frame as far as the
blur does: what lay there is unknown, begins as the frame's edges and is estimated with the rest,
so that no border rings. Pixels that the sensor clipped say only that the light was at least so
strong; with the sensor's response R in the model they can do no harm [2]:

    f <- f . A^T(g R'(A f) / R(A f) + 1 - R'(A f)) / A^T 1,
    R(x) = x - log(1 + exp(a (x - 1))) / a

References
----------
.. [1] D. Biggs and M. Andrews, "Acceleration of iterative image restoration algorithms",
   Applied Optics 36, 1997, https://doi.org/10.1364/AO.36.001766
.. [2] O. Whyte, J. Sivic and A. Zisserman, "Deblurring shaken and partially saturated images",
   IJCV 110, 2014, https://doi.org/10.1007/s11263-014-0727-3

"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from deshake.deconvolution.noise import coarse_noise, pair_means
from deshake.deconvolution.restoration import Restoration, check_photo
from deshake.operators.planes import channels_first
from deshake.operators.shake_blur import ShakeBlur
from deshake.operators.strips import available_threads

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.geometry.kernel import RotationKernel

__all__ = ["latent_start", "richardson_lucy"]

Image = NDArray[np.float32]
T = TypeVar("T")

_SHARPNESS = np.float32(50)  # a of the response
_LINEAR = np.float32(0.75)  # below it the response is a line, to within 1e-7
_DARK = np.float32(1e-6)  # less light than this counts as this
_UNSEEN = np.float32(1e-2)  # latent pixels seen less than this keep their value
_FASTEST = 0.75  # step of the extrapolation; with more, noise grows faster than detail
_SMALLEST = np.float32(0.25)  # share of a pixel that an extrapolation leaves at least
_FEWEST, _MOST = 2, 40
_STALLED = {True: 0.085, False: 0.02}  # by acceleration: falls of the residual to stop at
_STALLING = 1 / 1.6  # the falls shrink about as iterations^-1.6
_BAND = 128


def richardson_lucy(
    g: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    iterations: int | None = None,
    accelerated: bool = True,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Restoration:
    """Deblur a photo whose rotation kernel is known.

    The result lies in the frame of the blur's centroid: the kernel is centred first.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light, 1 where it clips; values below 0 count as 0.
    kernel : RotationKernel
        The blur, for a camera of the photo's size.
    clipped : (h, w) array of bool, optional
        Where the photo clipped. If anywhere, the model has the sensor's response in it.
    iterations : int, optional
        How many, >= 1. By default 2 to 40: until the residual has come down to the noise, at a
        scale where JPEG compression leaves noise alone (`coarse_noise`), or until an iteration
        takes less than 8.5 % off its square. Detail comes in fast, noise and the faults of an
        estimated kernel slowly.
    accelerated : bool
        Extrapolate from one iteration to the next [1]: the square root of as many iterations.
    threads : int, optional
        Threads to use; by default all processors. The result does not depend on it.
    progress : callable, optional
        Told the fraction done, 0 to 1, and what is being done, after each iteration.

    Returns
    -------
    Restoration

    Raises
    ------
    ValueError
        If the photo is not finite or does not fit the kernel's camera or the clipped pixels, or
        the iterations are fewer than 1.

    """
    check_photo(g, kernel, clipped, iterations)
    descent = _Descent(g, kernel.centred(), clipped, accelerated=accelerated, threads=threads)
    noise = coarse_noise(g) if iterations is None else 0.0
    stalled = _STALLED[accelerated]
    most = iterations or _MOST
    squared, done, part = np.inf, 0, 0.0
    while part < 1:
        before = squared
        squared, coarse = descent.step()
        done += 1
        part = done / most
        if iterations is None and done >= _FEWEST:
            fall = 1 - squared / before if squared > 0 else 0.0
            part = max(part, (stalled / max(fall, stalled)) ** _STALLING)
            part = max(part, np.sqrt(noise / max(coarse, noise)) if noise > 0 else 0.0)
        if progress is not None:
            progress(part, f"deblurring, iteration {done}")
    return Restoration(descent.frame(), done, float(np.sqrt(squared)))


def latent_start(
    g: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None,
    iterations: int,
    threads: int | None,
    progress: Callable[[float, str], None],
) -> Image:
    """Give another method something to start from, with lights that shine above the clip level.

    Parameters
    ----------
    g, kernel, clipped, threads
        As for `richardson_lucy`, but the kernel is centred already.
    iterations : int
        How many accelerated ones to do.
    progress : callable
        Told the fraction done, 0 to 1, and what is being done, after each iteration.

    Returns
    -------
    (C, H, W) array of float32
        The latent image with its margin, which is the reach of the kernel.

    """
    descent = _Descent(g, kernel, clipped, accelerated=True, threads=threads)
    for done in range(1, iterations + 1):
        descent.step()
        progress(done / iterations, f"deblurring lights, iteration {done}")
    return descent.f


class _Descent:
    """The latent image on its way, channel by channel.

    Three latent images are held: the estimate f; the point that the next iteration starts from,
    extrapolated from the last two estimates; and the change that the last iteration made of its
    point. Without extrapolation the first is all there is.
    """

    def __init__(
        self,
        g: Image,
        kernel: RotationKernel,
        clipped: NDArray[np.bool_] | None,
        *,
        accelerated: bool,
        threads: int | None,
    ) -> None:
        self.threads = threads or available_threads()
        self.like = g
        self.g = channels_first(g)
        self.clipped = clipped if clipped is not None and clipped.any() else None
        self.unclipped = g.size - (0 if self.clipped is None else self.clipped.sum() * len(self.g))
        self.blur = ShakeBlur(kernel, threads=threads)
        self.seen = self.blur.adjoint(np.ones(self.blur.observed_shape, np.float32))
        self.f = np.empty((len(self.g), *self.blur.latent_shape), np.float32)
        for c in range(len(self.g)):
            self.f[c] = self._start(self.g[c])
        self.point = self.f.copy() if accelerated else self.f
        self.change = np.zeros_like(self.f) if accelerated else None
        self.strength = 0.0  # of the last change: its squared norm

    def _start(self, g: Image) -> Image:
        """Blur the photo backwards, which takes its noise off, and continue its edges."""
        m = self.blur.margin
        back = self.blur.adjoint(np.maximum(g, 0)) / np.maximum(self.seen, _UNSEEN)
        inner: Image = np.pad(back[m:-m, m:-m], m, mode="edge")
        return np.maximum(inner, _DARK, out=inner)

    def step(self) -> tuple[float, float]:
        """Iterate once; return the mean squared residuals that the iteration began with.

        The first is of the pixels, the second of means of 2 x 2 of them, times four.
        """
        squared = coarse = along = strength = 0.0
        for c in range(len(self.f)):
            ratio = self.blur.forward(self.point[c])
            sums = self._each_band(len(ratio), partial(self._compare, ratio, c))
            squared += sum(part[0] for part in sums)
            coarse += sum(part[1] for part in sums)
            factor = self.blur.adjoint(ratio)
            parts = self._each_band(len(factor), partial(self._update, factor, c))
            along += sum(part[0] for part in parts)
            strength += sum(part[1] for part in parts)
        if self.change is not None:
            # [1], with the next point in the place of the estimate before
            step = np.float32(np.clip(along / self.strength, 0, _FASTEST) if self.strength else 0)
            self.strength = strength
            for c in range(len(self.f)):
                self._each_band(len(self.f[c]), partial(self._extrapolate, step, c))
            self.f, self.point = self.point, self.f
        count = max(int(self.unclipped), 1)
        return squared / count, coarse / count

    def frame(self) -> Image:
        """Give up the working images; return the estimate within the frame."""
        self.point = self.f
        self.change = None
        m = self.blur.margin
        out = np.empty_like(self.like, np.float32, order="C")
        channels_first(out)[...] = self.f[:, m:-m, m:-m]
        return out

    def _compare(self, blurred: Image, c: int, rows: slice) -> tuple[float, float]:
        """Turn the blurred point into the ratio to correct it by; sum the squared residuals."""
        x, g = np.maximum(blurred[rows], _DARK), np.maximum(self.g[c, rows], 0)
        if self.clipped is None:
            blurred[rows] = g / x
            residual = g - x
        else:
            high = x > _LINEAR
            over = _SHARPNESS * (x[high] - 1)
            x[high] -= np.logaddexp(0, over) / _SHARPNESS
            ratio = g / x
            slope = expit(-over)
            ratio[high] = ratio[high] * slope + (1 - slope)
            blurred[rows] = ratio
            residual = np.where(self.clipped[rows], 0, g - x)
        fine = np.sum(np.square(residual), dtype=np.float64)
        coarse = np.sum(np.square(pair_means(residual)), dtype=np.float64)
        return float(fine), 16 * float(coarse)  # four pixels to a mean, of a quarter the variance

    def _update(self, factor: Image, c: int, rows: slice) -> tuple[float, float]:
        """Correct the point; return the change's products with the last one and with itself."""
        seen, point = self.seen[rows], self.point[c, rows]
        factor, known = factor[rows], seen > _UNSEEN
        new = np.where(known, point * np.maximum(factor, 0) / np.where(known, seen, 1), point)
        along = strength = 0.0
        if self.change is not None:
            change, last = new - point, self.change[c, rows]
            along = float(np.sum(change * last, dtype=np.float64))
            strength = float(np.sum(np.square(change), dtype=np.float64))
            last[...] = change
        point[...] = new
        return along, strength

    def _extrapolate(self, step: np.float32, c: int, rows: slice) -> None:
        """Put the next point, from the corrected one and the estimate before, into the latter."""
        new, old = self.point[c, rows], self.f[c, rows]
        old[...] = np.maximum(new + step * (new - old), _SMALLEST * new)

    def _each_band(self, height: int, work: Callable[[slice], T]) -> list[T]:
        """Do some work on all rows, band by band; the results are in the order of the bands."""
        bands = [slice(top, top + _BAND) for top in range(0, height, _BAND)]
        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(work, bands))
