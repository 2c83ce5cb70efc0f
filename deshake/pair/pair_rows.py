"""Rows of B_N at chosen pixels: the least squares of Eq. (12), never with all of B_N in memory.

B_N has a row for each pixel and a column for each rotation: ``B_ik`` is the noisy photo where
rotation k maps pixel i to. Its noise adds to ``B_N' B_N``, mostly on the diagonal, and would favour
kernels that are spread out. Twins measure this: pictures of simulated noise like the photo's, after
the same processing as the photo. With the rows E of such a twin,

    G = B_N' B_N - mean E' E,    h = B_N' g

have the expectations of the noiseless ones. G may have negative eigenvalues.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.geometry.rotations import homographies
from deshake.operators.strips import bands, in_order
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.geometry.camera import Camera

__all__ = ["ROW_BLOCK", "PairRows"]

Image = NDArray[np.float32]
Vector = NDArray[np.float64]
Indices = NDArray[np.int64]

ROW_BLOCK = 64
"""Pixels come in blocks of this many."""

_ENTRIES = 4_000_000  # entries of B_N and E in memory at once, for each thread
_MOST_PLANES = 4  # planes that OpenCV interpolates at once
_INEXACT_PLANES = 2  # with this number of planes OpenCV rounds coordinates to 1/32 px


class PairRows:
    """Least squares of the kernel at some pixels, divided by their number.

    Parameters
    ----------
    camera : Camera
        The camera of the pictures.
    theta : (K, 3) array
        Rotations in radians.
    f : (C, h, w) array of float32
        The registered noisy photo, or its derivatives.
    g : (C, h, w) array of float32
        The same for the blurred photo.
    places : (n, 2) array of int
        Pixels (x, y) whose rows are used; n is a multiple of `ROW_BLOCK`.
    noise : sequence of (C, h, w) arrays
        The same for simulated noise; empty: f counts as free of noise.
    run : Run, optional
        Threads to use. The result does not depend on them.

    Raises
    ------
    ValueError
        If there is no block of pixels, or part of one.

    """

    def __init__(
        self,
        camera: Camera,
        theta: Vector,
        f: Image,
        g: Image,
        places: Indices,
        *,
        noise: Sequence[Image] = (),
        run: Run = Run(),
    ) -> None:
        if len(places) == 0 or len(places) % ROW_BLOCK:
            msg = f"{len(places)} pixels are no blocks of {ROW_BLOCK}"
            raise ValueError(msg)
        self._h = homographies(camera, theta)
        self._run = run
        self._twins = len(noise)
        planes = np.concatenate([f, *noise])
        self._planes = [_interleaved(planes[some]) for some in bands(len(planes), _MOST_PLANES)]
        self._channels = len(f)
        x, y = places.T
        self._points = np.stack([x, y, np.ones(len(places))]).astype(np.float64)
        self._g = np.ascontiguousarray(g[:, y, x], np.float32).ravel()
        self.right = self._adjoint([self._g])[0]

    def __len__(self) -> int:
        """Return the number n of pixels."""
        return int(self._points.shape[1])

    def gram(self, chosen: Indices) -> Vector:
        """Return the rows and columns of G that are chosen, (k, k)."""
        blocks = max(self._affordable // (max(len(chosen), 1) * ROW_BLOCK), 1)

        def work(pixels: slice) -> Image:
            b, *twins = self._columns(chosen, pixels)
            total: Image = b @ b.T
            for e in twins:
                total -= (e @ e.T) / np.float32(self._twins)
            return total

        gram = np.zeros((len(chosen), len(chosen)))
        for _, part in in_order(work, bands(len(self), blocks * ROW_BLOCK), self._run):
            gram += part
        gram /= len(self)
        return gram

    def slope(self, w: Vector) -> Vector:
        """Return ``G w - h``, (K,)."""
        used = np.flatnonzero(w)
        share = w[used].astype(np.float32)
        blurred = np.zeros((1 + self._twins, self._g.size), np.float32)
        whole = slice(0, len(self))
        for some in bands(len(used), max(self._affordable // len(self), 1)):
            for number, b in enumerate(self._columns(used[some], whole)):
                blurred[number] += share[some] @ b
        blurred[0] -= self._g
        slope, *twins = self._adjoint(list(blurred))
        for e in twins:
            slope -= e / self._twins
        return slope

    def misfits(self, w: Vector) -> tuple[float, float, float]:
        """Return the mean squares of g, of ``g - B w``, and of the best single rotation's residual.

        The effect of the noise of f is subtracted. Only rotations with a weight in w, (K,), count.
        """
        used = np.flatnonzero(w)
        gram, right = self.gram(used), self.right[used]
        energy = float(np.square(self._g, dtype=np.float64).sum()) / len(self)
        left = energy - 2 * right @ w[used] + w[used] @ gram @ w[used]
        single = energy + float((np.diagonal(gram) - 2 * right).min())
        return energy, float(left), single

    def scale(self, w: Vector) -> float:
        """Return the factor a of the best ``g ~ a B w``."""
        used = np.flatnonzero(w)
        return float(self.right[used] @ w[used] / (w[used] @ self.gram(used) @ w[used]))

    @property
    def _affordable(self) -> int:
        """Return the largest number of pixels times rotations in memory at once."""
        return _ENTRIES // (self._channels * (1 + self._twins))

    def _adjoint(self, rows: list[Image]) -> list[Vector]:
        """Apply the transposes of B, and of each E if given, to rows; divide by their number."""
        whole = slice(0, len(self))

        def work(some: slice) -> list[Image]:
            chosen = np.arange(some.start, some.stop)
            columns = self._columns(chosen, whole, sets=len(rows))
            return [b @ row for b, row in zip(columns, rows, strict=True)]

        out = [np.zeros(len(self._h)) for _ in rows]
        rotations = bands(len(self._h), max(self._affordable // len(self), 1))
        for some, parts in in_order(work, rotations, self._run):
            for total, part in zip(out, parts, strict=True):
                total[some] = part / len(self)
        return out

    def _columns(self, chosen: Indices, pixels: slice, sets: int | None = None) -> Image:
        """Return columns of B, then of each E, at some pixels: (sets, len(chosen), C n)."""
        points = self._points[:, pixels]
        size = points.shape[1]
        shape = (ROW_BLOCK, size // ROW_BLOCK)  # OpenCV limits the sides of maps
        count = 1 + self._twins if sets is None else sets
        out = np.empty((count * self._channels, len(chosen), size), np.float32)
        for place, k in enumerate(chosen):
            u, v, depth = self._h[k] @ points
            u = (u / depth).astype(np.float32).reshape(shape)
            v = (v / depth).astype(np.float32).reshape(shape)
            for number, planes in enumerate(self._planes):
                first = number * _MOST_PLANES
                if first >= len(out):
                    break
                sampled = cv2.remap(planes, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
                last = min(first + planes.shape[-1], len(out))
                out[first:last, place] = sampled.reshape(size, -1).T[: last - first]
        columns = out.reshape(count, self._channels, len(chosen), -1)
        joined: Image = np.moveaxis(columns, 1, 2).reshape(count, len(chosen), -1)
        return joined


def _interleaved(planes: Image) -> Image:
    """Turn planes (n, h, w) to an image (h, w, n), with one more that is empty if need be."""
    if len(planes) == _INEXACT_PLANES:
        planes = np.concatenate([planes, np.zeros_like(planes[:1])])
    return np.ascontiguousarray(np.moveaxis(planes, 0, -1))
