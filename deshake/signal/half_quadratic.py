"""Half-quadratic splitting.

The steps approach the sharp photo f that minimises

    1/2 |sqrt(m) s (A f - g)|^2 + tau sum |s D f|_k^p
        [+ 1/2 |sqrt(q) s (f - f_N)|^2]  [+ the prior of a denoiser],

with the symbols of `sparse_gradients`. A variable w approximates s D f, at a cost of rho / 2 |.|^2;
it has a closed form, pixel by pixel [1]. With a denoiser, its result v approximates s f, at a cost
of alpha / 2 |.|^2 [2]. The rest is a quadratic form in f: f moves one step of exact length along
its preconditioned gradient. The preconditioner divides by s, applies the blur's approximate
inverse, and divides by s again, since data and edges have the same weights. Light is not negative:
where a step of length 1 would take f below 0, the direction is shortened to end there. f_N, if
given, is another photo of the scene: sharp, but noisy.

A short step says that the approximate inverse is too large: it takes frequencies for lost that the
blur keeps beside that place. Then the next steps are damped [3].

References
----------
.. [1] D. Krishnan and R. Fergus, "Fast image deconvolution using hyper-Laplacian priors",
   NIPS 2009.
.. [2] S. Venkatakrishnan, C. Bouman and B. Wohlberg, "Plug-and-play priors for model based
   reconstruction", GlobalSIP 2013, https://doi.org/10.1109/GlobalSIP.2013.6737048
.. [3] D. Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", Journal of
   the Society for Industrial and Applied Mathematics 11, 1963.

"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from deshake.operators.strips import bands, in_order
from deshake.run import Run
from deshake.signal.opponent import plane_weights, reflect, squared_lengths, weigh_colour
from deshake.signal.shrinkage import shrunk

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.operators.patch_inverse import FourierInverse, PatchInverse

__all__ = ["HalfQuadratic"]

Image = NDArray[np.float32]
T = TypeVar("T")

_POWER = 0.7  # p
_TAU = 0.26  # tau of one plane; for C planes it is multiplied by the root of C
_COLOUR = 1.5  # k
_SHORT = 0.6  # length of a step after which the next ones are damped
_DAMPING = 0.016  # the first one, added to the power of the blur, whose filters have the sum 1
_GROWTH = 3  # of the damping after each further short step
_BAND_PIXELS = 1 << 17  # pixels of a band, all channels: its arrays stay in the cache


class HalfQuadratic:
    """The latent image f during the stages, with A f, both channel by channel, (C, ., .).

    Parameters
    ----------
    f : (C, H, W) array of float32
        First estimate of the latent image, with the blur's margin; linear light, >= 0. The steps
        change it.
    Af : (C, h, w) array of float32
        The estimate, blurred; the steps change it.
    g : (C, h, w) array of float32
        The photo, linear.
    inverse : FourierInverse or PatchInverse
        Approximate inverse of the blur A.
    m : (h, w) array of float32
        Trust in each pixel, 0..1.
    s : (H, W) array of float32
        1 / sigma of the noise; changes slowly.
    f_N : (C, H, W) array of float32, optional
        The second photo, with the blur's margin. Pixels where q is 0 do not count.
    q : (H, W) array of float32, optional
        Trust in each pixel of f_N, in units of s^2: the precision of f_N over s^2.
    tau : float, optional
        Weight of the prior, > 0; by default 0.26 times the root of the number of planes.
    run : Run, optional
        Threads to use. The result does not depend on them.

    """

    def __init__(
        self,
        f: Image,
        Af: Image,
        g: Image,
        inverse: FourierInverse | PatchInverse,
        *,
        m: Image,
        s: Image,
        f_N: Image | None = None,
        q: Image | None = None,
        tau: float | None = None,
        run: Run = Run(),
    ) -> None:
        self.f, self.Af, self.g, self.m, self.s = f, Af, g, m, s[None]
        self.inverse, self.blur = inverse, inverse.filters
        self.margin = (f.shape[1] - g.shape[1]) // 2
        self.tau = _TAU * len(g) ** 0.5 if tau is None else tau
        self.f_N, self.q = f_N, q
        self._near = self._nearness()
        self._damping = 0.0
        self._moved = 0.0
        self.run = run

    def step(self, rho: float, alpha: float = 0.0, v: Image | None = None) -> None:
        """Compute the gradients w for f, then move f by one preconditioned step.

        Parameters
        ----------
        rho : float
            Cost of the difference of s D f and w, > 0.
        alpha : float
            Cost of the difference of s f and v, >= 0.
        v : (C, H, W) array of float32, optional
            The denoised s f; needed if alpha > 0.

        """
        height, frame = self.f.shape[1], self.Af.shape[1]
        r = np.empty_like(self.Af)
        self._each_band(frame, partial(self._weigh_residual, r))
        gradient = self.blur.adjoint(r)
        del r
        self._each_band(height, partial(self._add_priors, gradient, rho, alpha, v))
        d = self.inverse.apply(
            gradient,
            rho * plane_weights(len(gradient), _COLOUR),
            self._near + alpha + self._damping,
        )
        products = self._each_band(height, partial(self._directed, gradient, d))
        along, moving = (sum(terms) for terms in zip(*products, strict=True))
        del gradient
        squared = sum(self._each_band(height, partial(self._prior_power, d, rho, alpha)))
        Ad = self.blur.forward(d)
        squared += sum(self._each_band(frame, partial(self._seen_power, Ad)))
        length = np.float32(max(along, 0) / squared if squared > 0 else 0)
        self._each_band(height, partial(self._move, self.f, d, length))
        self._each_band(frame, partial(self._move, self.Af, Ad, length))
        self._moved = float(length) * (moving / d.size) ** 0.5
        if length < _SHORT:
            self._damping = _GROWTH * self._damping or _DAMPING

    @property
    def moved(self) -> float:
        """How far the last step moved f: root mean square of s times the change, no unit."""
        return self._moved

    @property
    def damped(self) -> bool:
        """Whether a step was short, so that the next ones are damped."""
        return self._damping > 0

    def replace_filters(self, inverse: FourierInverse | PatchInverse) -> None:
        """Take other filters for the same blur, and their approximate inverse."""
        self.inverse, self.blur = inverse, inverse.filters
        self.Af = self.blur.forward(self.f)
        self._near = self._nearness()

    def residual(self, clipped: NDArray[np.bool_] | None) -> float:
        """Root mean square of g - A f over the unclipped pixels."""
        counted = np.ones(self.m.shape, bool) if clipped is None else ~clipped
        total = 0.0
        for g, Af in zip(self.g, self.Af, strict=True):
            total += float(np.sum(np.square(g - Af), where=counted, dtype=np.float64))
        return float(np.sqrt(total / max(int(counted.sum()) * len(self.g), 1)))

    def _nearness(self) -> Image | np.float32:
        """Return the mean of q over each patch of the approximate inverse; 0 without q."""
        return np.float32(0) if self.q is None else self.inverse.means(self._framed(self.q))

    def _framed(self, latent: Image) -> Image:
        """Cut the frame out of a latent map (H, W)."""
        m = self.margin
        return np.ascontiguousarray(latent[m : len(latent) - m, m : latent.shape[1] - m])

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
        """Put m s^2 (g - A f) into r."""
        m = self.margin
        s = self.s[:, rows.start + m : rows.stop + m, m:-m]
        part = np.subtract(self.g[:, rows], self.Af[:, rows], out=r[:, rows])
        part *= self.m[rows] * s * s

    def _add_priors(
        self, gradient: Image, rho: float, alpha: float, v: Image | None, rows: slice
    ) -> None:
        """Subtract the priors' gradients, divide by s, and separate light and colours."""
        first = max(rows.start - 1, 0)
        down, across = self._slopes(slice(first, rows.stop))
        n = squared_lengths(down, _COLOUR)
        n += squared_lengths(across, _COLOUR)
        np.sqrt(np.maximum(n, 0, out=n), out=n)
        rest = 1 - shrunk(n, self.tau / rho, _POWER)
        rest *= np.float32(rho) * self.s[0, first : rows.stop]
        weigh_colour(down, _COLOUR)
        weigh_colour(across, _COLOUR)
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
        if self.f_N is not None and self.q is not None:
            weight = self.q[rows] * self.s[0, rows]
            part += weight * (self.f_N[:, rows] - self.f[:, rows])
        if v is not None:
            part += np.float32(alpha) * (v[:, rows] - self.s[:, rows] * self.f[:, rows])
        reflect(part)

    def _directed(self, gradient: Image, d: Image, rows: slice) -> tuple[float, float]:
        """Undo the reflection of d, divide it by s, and keep f + d above 0.

        Return the product of the gradient and s d, and |s d|^2.
        """
        s, down, part = self.s[:, rows], gradient[:, rows], d[:, rows]
        reflect(down)
        reflect(part)
        part /= s
        f = self.f[:, rows]
        np.maximum(part, -f, out=part)
        sd = s * part
        return float(np.sum(down * sd, dtype=np.float64)), float(np.sum(sd * sd, dtype=np.float64))

    def _prior_power(self, d: Image, rho: float, alpha: float, rows: slice) -> float:
        """Return rho |s D d|_k^2 + |sqrt(alpha + q) s d|^2, summed over some rows."""
        below = d[:, rows.start : rows.stop + 1]
        here = below[:, : rows.stop - rows.start]
        s = np.float32(rho) * np.square(self.s[0, rows])
        down = squared_lengths(below[:, 1:] - below[:, :-1], _COLOUR)
        across = squared_lengths(here[..., 1:] - here[..., :-1], _COLOUR)
        total = np.sum(down * s[: len(down)], dtype=np.float64)
        total += np.sum(across * s[:, :-1], dtype=np.float64)
        if alpha > 0 or self.q is not None:
            near = np.float32(alpha) + (self.q[rows] if self.q is not None else 0)
            total += np.sum(near * np.square(here * self.s[:, rows]), dtype=np.float64)
        return float(total)

    def _seen_power(self, Ad: Image, rows: slice) -> float:
        """Return |sqrt(m) s A d|^2, summed over some rows."""
        m = self.margin
        part = np.square(Ad[:, rows] * self.s[:, rows.start + m : rows.stop + m, m:-m])
        part *= self.m[rows]
        return float(np.sum(part, dtype=np.float64))

    def _move(self, image: Image, d: Image, length: np.float32, rows: slice) -> None:
        """Move an image along d."""
        image[:, rows] += length * d[:, rows]

    def _each_band(self, height: int, work: Callable[[slice], T]) -> list[T]:
        """Do the work on all rows, band by band; the results are in the order of the bands."""
        step = max(8, _BAND_PIXELS // (self.f.shape[2] * len(self.f)))
        return [done for _, done in in_order(work, bands(height, step), self.run)]
