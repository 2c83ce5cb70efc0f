"""Overlapping patches of the frame, filtered one by one through FFTs.

This is efficient filter flow (Hirsch et al., CVPR 2010) without rotations. The observed frame,
h x w, is cut into patches at every s pixels. Neighbours share a ramp of t pixels, t <= s, in which
one fades out and the other in: a patch has a side of s + t pixels, and windows sum to one
everywhere. With t = s the windows are triangles. Patch p, whose upper left pixel is
``o_p = p s - t``, depends on the block of N x N pixels of the latent image that begins at
``o_p - r``, where r bounds the reach of every filter. With filters ``h_p(u)``, ``|u| <= r``, stored
at indices 0 .. 2r:

    forward   g = sum_p win_p . F^-1[ F(block_p f) conj(F h_p) ]
    adjoint   f = sum_p block_p' F^-1[ F(win_p . g) F h_p ]

need no shift. The latent image has a margin of m pixels on every side of the observed frame; beyond
it, it is zero.

The work is cut into strips, which the threads share, and these into batches that stay in the cache.
Neither depends on the number of threads, so the results do not depend on it.
"""

from __future__ import annotations

from copy import copy
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import add_at, channels_first, check_size, image_like, window_of
from deshake.operators.strips import Strip, bands, in_order
from deshake.operators.transforms import transforms
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

__all__ = [
    "PatchGrid",
    "Strip",
    "channels_first",
    "image_like",
]

Image = NDArray[np.float32]
T = TypeVar("T")

_STRIP_BYTES = 4 << 20  # bytes of the blocks of a strip, one channel, at most
_BATCH_BYTES = 1 << 20  # bytes of the blocks transformed at once, all channels: they stay in cache


def _keep_freed_memory() -> None:
    """Make batches reuse their memory, which saves up to a third of their time.

    The C library of Linux returns freed arrays to the system, and requests them again page by
    page, until one array of nearly 32 MiB was freed. This function frees such an array, which is
    never touched. On other systems it has no effect.
    """
    piece = np.empty((32 << 20) - (64 << 10), np.uint8)
    del piece


_keep_freed_memory()


class PatchGrid:
    """The patches of a frame and the blocks of the latent image that they depend on.

    Parameters
    ----------
    shape : (int, int)
        Height and width of the observed frame in pixels.
    radius : int
        Largest reach r of a filter in pixels.
    hop : int
        Distance s from patch to patch in pixels.
    margin : int
        Pixels m by which the latent image is larger on every side.
    ramp : int, optional
        Pixels t in which neighbouring patches are mixed, 1 to `hop`; by default `hop`.
    channels : int
        Expected number of channels, for the size of the batches.
    run : Run, optional
        Threads to use. The result does not depend on them.

    """

    def __init__(
        self,
        shape: tuple[int, int],
        radius: int,
        hop: int,
        margin: int,
        *,
        ramp: int | None = None,
        channels: int = 1,
        run: Run = Run(),
    ) -> None:
        self.shape = shape
        self.radius = radius
        self.hop = hop
        self.ramp = hop if ramp is None else ramp
        self.margin = margin
        self.patch = hop + self.ramp
        self.transforms = transforms(self.patch + 2 * radius)
        self.block = self.transforms.length
        self.reach = 2 * radius + 1
        self.rows, self.columns = (-(-(side + self.ramp) // hop) for side in shape)
        self.run = run
        away = np.abs(np.arange(self.patch) + 0.5 - self.patch / 2)
        fade = np.minimum((self.patch / 2 - away) / self.ramp, 1).astype(np.float32)
        self.window = (np.outer(fade, fade) / self.transforms.gain).astype(np.float32)
        block_bytes = 4 * self.block * self.block
        self.batch = max(1, _BATCH_BYTES // (channels * block_bytes))
        parts = -(-self.columns // max(1, _STRIP_BYTES // block_bytes))
        bounds = np.linspace(0, self.columns, parts + 1).astype(int)
        self.strips = [
            Strip(row, int(a), int(b)) for row in range(self.rows) for a, b in pairwise(bounds)
        ]

    @property
    def latent_shape(self) -> tuple[int, int]:
        """Height and width of the latent image in pixels."""
        return self.shape[0] + 2 * self.margin, self.shape[1] + 2 * self.margin

    def centres(self, strip: Strip) -> NDArray[np.float64]:
        """Return the centres (x, y) of a strip's patches, clipped to the frame, (count, 2)."""
        height, width = self.shape
        first = (self.hop - self.ramp - 1) / 2
        x = np.clip(np.arange(strip.first, strip.last) * self.hop + first, 0, width - 1)
        y = np.clip(strip.row * self.hop + first, 0, height - 1)
        return np.stack([x, np.full_like(x, y)], 1)

    def map_strips(self, work: Callable[[Strip], T]) -> Iterator[tuple[Strip, T]]:
        """Yield `work` of every strip, in order, with a few strips under way at once.

        The order makes sums over strips independent of the number of threads.
        """
        return in_order(work, self.strips, self.run)

    def near(self, marked: NDArray[np.bool_]) -> PatchGrid:
        """Return the grid with only those strips that depend on marked latent pixels (H, W).

        Raises
        ------
        ValueError
            If the array has another size than the grid's latent images.

        """
        check_size(marked[None], self.latent_shape)
        part = copy(self)
        part.strips = [strip for strip in self.strips if marked[self._covered(strip)].any()]
        return part

    def _covered(self, strip: Strip) -> tuple[slice, slice]:
        """Return the latent pixels that the patches of a strip depend on."""
        y, x = self._origin(strip, self.margin - self.radius)
        side = self.patch + 2 * self.radius
        wide = side + (strip.count - 1) * self.hop
        return slice(max(y, 0), y + side), slice(max(x, 0), x + wide)

    def batches(self, strip: Strip) -> list[slice]:
        """Cut a strip into batches of patches that stay in the cache."""
        return bands(strip.count, self.batch)

    def blocks(self, latent: Image, strip: Strip) -> Image:
        """View the blocks (C, count, N, N) of a latent (C, H, W) for a strip's patches."""
        origin = self._origin(strip, self.margin - self.radius)
        n = self.block
        covered = window_of(latent, *origin, n, n + (strip.count - 1) * self.hop)
        view = np.lib.stride_tricks.sliding_window_view(covered, n, axis=2)[:, :, :: self.hop]
        return np.moveaxis(view, 2, 1)

    def patches(self, observed: Image, strip: Strip) -> Image:
        """View a strip's patches (C, count, s + t, s + t) of an observed (C, h, w)."""
        origin = self._origin(strip, 0)
        p = self.patch
        covered = window_of(observed, *origin, p, p + (strip.count - 1) * self.hop)
        view = np.lib.stride_tricks.sliding_window_view(covered, p, axis=2)[:, :, :: self.hop]
        return np.moveaxis(view, 2, 1)

    def padding(self, channels: int, strip: Strip) -> Image:
        """Make zeros (C, batch, N, N), into whose corners the patches of a batch can be put."""
        return np.zeros(
            (channels, min(self.batch, strip.count), self.block, self.block), np.float32
        )

    def padded(self, patches: Image, padding: Image) -> Image:
        """Put patches (C, count, s + t, s + t), times their window, into zeros of `padding`."""
        out = padding[:, : patches.shape[1]]
        for at in np.ndindex(patches.shape[:2]):
            cv2.multiply(patches[at], self.window, out[at][: self.patch, : self.patch])
        return out

    def canvas(self, channels: int, strip: Strip, size: int) -> Image:
        """Make zeros (C, n, n + (count - 1) hop) to add a strip's pieces of n x n pixels to."""
        return np.zeros((channels, size, size + (strip.count - 1) * self.hop), np.float32)

    def overlap_add(
        self, pieces: Image, out: Image, first: int = 0, window: Image | None = None
    ) -> None:
        """Add pieces (C, count, n, n), times a window, to a canvas, from patch `first` on."""
        wide = pieces.shape[-1]
        for plane, row in zip(pieces, out, strict=True):
            for j, piece in enumerate(plane, first):
                place = row[:, j * self.hop : j * self.hop + wide]
                if window is None:
                    cv2.accumulate(piece, place)
                else:
                    cv2.accumulateProduct(piece, window, place)

    def add_observed(self, out: Image, strip: Strip, piece: Image) -> None:
        """Add a strip's patches, overlapped, to an observed image (C, h, w)."""
        add_at(out, *self._origin(strip, 0), piece)

    def add_latent(self, out: Image, strip: Strip, piece: Image) -> None:
        """Add a strip's blocks, overlapped, to a latent image (C, H, W)."""
        add_at(out, *self._origin(strip, self.margin - self.radius), piece)

    def cross_correlations(
        self, observed: Image, latent: Image, reduce: Callable[[Strip, Image], T]
    ) -> Iterable[tuple[Strip, T]]:
        """Correlate observed and latent images patch by patch.

        ``cc_p(u) = sum_c sum_i win_p(i) observed_c(i) latent_c(i + u)`` for ``|u| <= r``. `reduce`
        gets a strip and its (count, 2r+1, 2r+1) correlations; its result is yielded.

        Raises
        ------
        ValueError
            If an image has another size than the grid's.

        """
        check_size(observed, self.shape)
        check_size(latent, self.latent_shape)

        def work(strip: Strip) -> T:
            out = np.empty((strip.count, self.reach, self.reach), np.float32)
            patches, blocks = self.patches(observed, strip), self.blocks(latent, strip)
            padded = self.padding(len(observed), strip)
            for batch in self.batches(strip):
                product = self.transforms.rfft(blocks[:, batch])
                patch_spectra = self.transforms.rfft(self.padded(patches[:, batch], padded))
                self.transforms.multiply(product, patch_spectra, conjugate=True)
                for more in product[1:]:
                    product[0] += more
                out[batch] = self.transforms.irfft(product[0], self.reach)
            return reduce(strip, out)

        return self.map_strips(work)

    def autocorrelations(self, observed: Image, strip: Strip) -> Image:
        """Autocorrelate a strip's patches under the root of their windows.

        ``ac_p(v) = sum_c sum_i sqrt(win_p(i) win_p(i+v)) o_c(i) o_c(i+v)``, (count, 4r+1, 4r+1)
        with lag 0 in the middle.
        """
        product = self.transforms.rfft(self.patches(observed, strip) * np.sqrt(self.window))
        self.transforms.multiply(product, product, conjugate=True)
        lags = min(2 * self.radius, self.patch - 1)  # beyond a patch's width there is nothing
        rolled = np.roll(self.transforms.irfft(product.sum(0)), (lags, lags), (1, 2))
        beyond = 2 * self.radius - lags
        within = rolled[:, : 2 * lags + 1, : 2 * lags + 1]
        return np.pad(within, ((0, 0), (beyond, beyond), (beyond, beyond)))

    def _origin(self, strip: Strip, offset: int) -> tuple[int, int]:
        """Row and column where a strip begins, plus an offset."""
        offset -= self.ramp
        return strip.row * self.hop + offset, strip.first * self.hop + offset
