"""Restoration with a known rotation kernel and sparse gradients: the default.

The sharp photo is the f that minimises

    1/2 |s (A f - g)|^2 + tau sum |s D f|^p,    p = 0.6,

where A is the filter flow of the kernel on a latent image that reaches beyond the frame as far as
the blur does, D the differences of neighbours, down and across, and |.| takes both of these and
all colours together. s = 1 / sigma(x) divides by the noise, whose variance grows with the light;
edges count in the same units, which are nearly those of display, so that dark and bright parts
are smoothed alike. The light is averaged over the reach of the blur first: a weight that changes
slowly passes through A, nearly, and what the model misses at bright edges is not taken for detail
of the dark beside them. A share of what the first estimate leaves unexplained is added to the
noise, since no kernel is quite right.

Half-quadratic splitting [1] puts v near s D f, at a cost of rho / 2, which rises from stage to
stage. In each stage v is found in closed form, pixel by pixel, and f moves one step of exact length
along the preconditioned gradient. The preconditioner is the blur's inverse patch by patch between
divisions by s, since data and edges carry the same weights.

The first estimate is that of a few iterations of Richardson-Lucy, in whose model clipped lights
may be brighter than they look; a clipped pixel that the estimate outshines is left alone.

References
----------
.. [1] D. Krishnan and R. Fergus, "Fast image deconvolution using hyper-Laplacian priors",
   NIPS 2009.

"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from deshake.deconvolution.noise import noise_model, smoothed
from deshake.deconvolution.restoration import Restoration, check_photo
from deshake.deconvolution.richardson_lucy import latent_start
from deshake.deconvolution.shrinkage import lengths, shrunk
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.patch_inverse import PatchInverse
from deshake.operators.planes import channels_first
from deshake.operators.strips import available_threads

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.geometry.kernel import RotationKernel

__all__ = ["sparse_gradients"]

Image = NDArray[np.float32]
T = TypeVar("T")

_STAGES = 4
_RHO = (0.1, 1.0)
_POWER = 0.6
_TAU = 0.8
_MISFIT = 0.2  # of what the start leaves unexplained, that is reckoned as noise
_DARKEST = 0.01  # light that is added before noise is reckoned: no model is right in the dark
_START, _BRIGHT_START = 6, 8  # iterations of Richardson-Lucy to begin with
_CLIPPED = 5e-4  # share of clipped pixels from which there are more of them
_START_SHARE = 0.5  # of the time
_NEGATIVE = 0.01  # squared negative light, in noise variances a pixel, that is cut off
_BAND_PIXELS = 1 << 17  # the pixels of a band, all channels: its arrays stay in the cache


def sparse_gradients(
    g: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    iterations: int | None = None,
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
        Where the photo clipped. There the light may be stronger than it looks, and never weaker.
    iterations : int, optional
        Stages of the splitting after the start, >= 1; by default 4.
    threads : int, optional
        Threads to use; by default all processors. The result does not depend on it.
    progress : callable, optional
        Told the fraction done, 0 to 1, and what is being done, after each stage.

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
    stages = iterations or _STAGES
    descent = _Descent(g, kernel.centred(), clipped, threads=threads)
    descent.start(lambda share, text: _tell(progress, _START_SHARE * share, text))
    for stage, rho in enumerate(np.geomspace(*_RHO[::-1], stages)[::-1], 1):
        descent.step(np.float32(rho))
        share = _START_SHARE + (1 - _START_SHARE) * stage / stages
        _tell(progress, share, f"deblurring, stage {stage}")
    return Restoration(descent.frame(), stages, descent.residual())


def _tell(progress: Callable[[float, str], None] | None, share: float, text: str) -> None:
    if progress is not None:
        progress(share, text)


class _Descent:
    """The latent image f on its way, with A f, both channel by channel, (C, ., .)."""

    def __init__(
        self,
        g: Image,
        kernel: RotationKernel,
        clipped: NDArray[np.bool_] | None,
        *,
        threads: int | None,
    ) -> None:
        self.like, self.kernel = g, kernel
        self.g = channels_first(g)
        self.clipped = clipped if clipped is not None and clipped.any() else None
        self.threads = threads or available_threads()
        used = kernel.weights > 0
        flow = FilterFlow(kernel.camera, kernel.theta[used], channels=len(self.g), threads=threads)
        self.margin = flow.margin
        self.blur = flow.filters(kernel.weights[used])
        self.inverse = PatchInverse(self.blur)

    def start(self, progress: Callable[[float, str], None]) -> None:
        """Begin with a few iterations of Richardson-Lucy, and some more if lights clipped."""
        bright = self.clipped is not None and float(self.clipped.mean()) > _CLIPPED
        self.f = latent_start(
            self.like,
            self.kernel,
            clipped=self.clipped,
            iterations=_BRIGHT_START if bright else _START,
            threads=self.threads,
            progress=progress,
        )
        self.Af = self.blur.forward(self.f)
        self.s = self._precision()

    def _precision(self) -> Image:
        """Return 1 / sigma of every latent pixel, (1, H, W)."""
        slope, floor = noise_model(self.like)
        light, error = np.zeros((2, *self.g.shape[1:]), np.float32)
        for g, Af in zip(self.g, self.Af, strict=True):
            light += np.maximum(g, 0)
            error += np.square(g - Af)
        if self.clipped is not None:
            error[self.clipped] = 0
        light *= np.float32(slope / len(self.g))
        error *= np.float32(_MISFIT / len(self.g))
        light += error
        variance = smoothed(light, max(self.margin // 2, 1))
        variance += np.float32(slope * _DARKEST + floor)
        np.sqrt(variance, out=variance)
        np.reciprocal(variance, out=variance)
        return np.pad(variance, self.margin, mode="edge")[None]

    def step(self, rho: np.float32) -> None:
        """Find the gradients v for f, then move f by one preconditioned step."""
        height, frame = self.f.shape[1], self.Af.shape[1]
        r = np.empty_like(self.Af)
        self._each_band(frame, partial(self._weigh_residual, r))
        gradient = self.blur.adjoint(r)
        del r
        self._each_band(height, partial(self._add_prior, gradient, rho))
        d = self.inverse.apply(gradient, float(rho))
        along = sum(self._each_band(height, partial(self._product, gradient, d)))
        del gradient
        squared = float(rho) * sum(self._each_band(height, partial(self._roughness, d)))
        Ad = self.blur.forward(d)
        squared += sum(self._each_band(frame, partial(self._seen_power, Ad)))
        length = np.float32(along / squared if squared > 0 else 0)
        negative = sum(self._each_band(height, partial(self._move, self.f, d, length)))
        self._each_band(frame, partial(self._move, self.Af, Ad, length))
        if negative > _NEGATIVE * self.f.size:
            np.maximum(self.f, 0, out=self.f)
            self.Af = self.blur.forward(self.f)

    def frame(self) -> Image:
        """Return the estimate within the frame."""
        m = self.margin
        out = np.empty_like(self.like, np.float32, order="C")
        np.maximum(self.f[:, m:-m, m:-m], 0, out=channels_first(out))
        return out

    def residual(self) -> float:
        """Root mean square of what A f leaves unexplained of the unclipped pixels."""
        sums = self._each_band(self.Af.shape[1], self._squares)
        count = self.g.size - (0 if self.clipped is None else self.clipped.sum() * len(self.g))
        return float(np.sqrt(sum(sums) / max(int(count), 1)))

    def _squares(self, rows: slice) -> float:
        r = self.g[:, rows] - self.Af[:, rows]
        if self.clipped is not None:
            r[:, self.clipped[rows]] = 0
        return float(np.sum(np.square(r), dtype=np.float64))

    def _slopes(self, rows: slice) -> tuple[Image, Image]:
        """Return s D f of some rows: down and across."""
        below = self.f[:, rows.start : rows.stop + 1]
        here = below[:, : rows.stop - rows.start]
        down, across = np.zeros_like(here), np.zeros_like(here)
        np.subtract(below[:, 1:], below[:, :-1], out=down[:, : below.shape[1] - 1])
        np.subtract(here[..., 1:], here[..., :-1], out=across[..., :-1])
        s = self.s[:, rows]
        down *= s
        across *= s
        return down, across

    def _weigh_residual(self, r: Image, rows: slice) -> None:
        """Put s^2 (g - A f) into r, but 0 where a clipped pixel is outshone."""
        m = self.margin
        s = self.s[:, rows.start + m : rows.stop + m, m:-m]
        part = np.subtract(self.g[:, rows], self.Af[:, rows], out=r[:, rows])
        if self.clipped is not None:
            part[self.clipped[rows] & (part < 0)] = 0
        part *= s * s

    def _add_prior(self, gradient: Image, rho: np.float32, rows: slice) -> None:
        """Take rho D^T s (s D f - v) off the gradient, and divide it by s."""
        first = max(rows.start - 1, 0)
        down, across = self._slopes(slice(first, rows.stop))
        rest = 1 - shrunk(lengths(down, across), _TAU / float(rho), _POWER)
        rest *= rho * self.s[0, first : rows.stop]
        down *= rest
        across *= rest
        part = gradient[:, rows]
        part += down[:, rows.start - first :]
        if first < rows.start:
            part -= down[:, :-1]
        else:
            part[:, 1:] -= down[:, :-1]
        across = across[:, rows.start - first :]
        part += across
        part[..., 1:] -= across[..., :-1]
        part /= self.s[:, rows]

    def _product(self, gradient: Image, d: Image, rows: slice) -> float:
        """Multiply the two, and divide the second by s."""
        product = float(np.sum(gradient[:, rows] * d[:, rows], dtype=np.float64))
        d[:, rows] /= self.s[:, rows]
        return product

    def _roughness(self, d: Image, rows: slice) -> float:
        """Square s D d."""
        below = d[:, rows.start : rows.stop + 1]
        here = below[:, : rows.stop - rows.start]
        s = np.square(self.s[0, rows])
        down = np.square(below[:, 1:] - below[:, :-1]).sum(0)
        across = np.square(here[..., 1:] - here[..., :-1]).sum(0)
        total = np.sum(down * s[: len(down)], dtype=np.float64)
        return float(total + np.sum(across * s[:, :-1], dtype=np.float64))

    def _seen_power(self, Ad: Image, rows: slice) -> float:
        """Square s A d where the residual counts."""
        m = self.margin
        part = np.square(Ad[:, rows] * self.s[:, rows.start + m : rows.stop + m, m:-m])
        if self.clipped is not None:
            part[self.clipped[rows] & (self.g[:, rows] < self.Af[:, rows])] = 0
        return float(np.sum(part, dtype=np.float64))

    def _move(self, image: Image, d: Image, length: np.float32, rows: slice) -> float:
        """Move an image along d; return its squared negative light, in noise variances."""
        part = image[:, rows]
        part += length * d[:, rows]
        if image is not self.f or part.min() >= 0:
            return 0.0
        return float(np.sum(np.square(np.minimum(part, 0) * self.s[:, rows]), dtype=np.float64))

    def _each_band(self, height: int, work: Callable[[slice], T]) -> list[T]:
        """Do some work on all rows, band by band; the results are in the order of the bands."""
        step = max(8, _BAND_PIXELS // (self.f.shape[2] * len(self.f)))
        bands = [slice(top, min(top + step, height)) for top in range(0, height, step)]
        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(work, bands))
