"""Overlapping patches of the frame, filtered one by one through FFTs.

The machinery of efficient filter flow (Hirsch et al., CVPR 2010), knowing nothing of rotations.
The observed frame, h x w, is cut into patches of 2s x 2s pixels at every s pixels, with triangular
windows that sum to one everywhere. Patch p, whose upper left pixel is ``o_p = p s - s``, looks at
the block of N x N pixels of the latent image that begins at ``o_p - r``, where r bounds the reach
of every filter. With filters ``h_p(u)``, ``|u| <= r``, stored at indices 0 .. 2r:

    forward   g = sum_p win_p . F^-1[ F(block_p f) conj(F h_p) ]
    adjoint   f = sum_p block_p' F^-1[ F(win_p . g) F h_p ]

needs no shift. The latent image has a margin of m pixels on every side of the observed frame;
what lies beyond is zero.
"""

from __future__ import annotations

import os
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import scipy.fft
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

__all__ = ["LocalFilters", "PatchGrid", "Strip", "available_threads", "channels_first", "image_like"]

Image = NDArray[np.float32]
T = TypeVar("T")
Spectrum = NDArray[np.complex64]

_STRIP_BYTES = 24 << 20  # the blocks of one strip fill at most this much memory
_SPECTRA_BYTES = 1 << 30  # spectra are kept up to this size, and recomputed beyond it


def available_threads() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True)
class Strip:
    """Neighbouring patches of one row: columns first .. last - 1 of row `row`."""

    row: int
    first: int
    last: int

    @property
    def count(self) -> int:
        """Number of patches."""
        return self.last - self.first


class PatchGrid:
    """The patches of a frame and the blocks of the latent image that they see.

    Parameters
    ----------
    shape : (int, int)
        Height and width of the observed frame in pixels.
    radius : int
        Largest reach r of a filter in pixels.
    hop : int
        Distance s from patch to patch in pixels; a patch is 2s wide.
    margin : int
        Pixels m by which the latent image is larger on every side.
    channels : int
        Expected number of channels, for the size of the strips.
    threads : int, optional
        How many strips are worked on at once; by default all processors.

    """

    def __init__(
        self,
        shape: tuple[int, int],
        radius: int,
        hop: int,
        margin: int,
        *,
        channels: int = 1,
        threads: int | None = None,
    ) -> None:
        self.shape = shape
        self.radius = radius
        self.hop = hop
        self.margin = margin
        self.patch = 2 * hop
        self.block: int = scipy.fft.next_fast_len(self.patch + 2 * radius, real=True)
        self.reach = 2 * radius + 1
        self.rows = -(-shape[0] // hop) + 1
        self.columns = -(-shape[1] // hop) + 1
        self.threads = threads or available_threads()
        ramp = (1 - np.abs(np.arange(self.patch) + 0.5 - hop) / hop).astype(np.float32)
        self.window = np.outer(ramp, ramp)
        fit = max(1, _STRIP_BYTES // (4 * channels * self.block * self.block))
        parts = -(-self.columns // fit)
        bounds = np.linspace(0, self.columns, parts + 1).astype(int)
        self.strips = [
            Strip(row, int(a), int(b))
            for row in range(self.rows)
            for a, b in zip(bounds[:-1], bounds[1:], strict=True)
        ]

    @property
    def latent_shape(self) -> tuple[int, int]:
        """Height and width of the latent image in pixels."""
        return self.shape[0] + 2 * self.margin, self.shape[1] + 2 * self.margin

    def centres(self, strip: Strip) -> NDArray[np.float64]:
        """Middles (x, y) of a strip's patches, clipped to the frame, (count, 2)."""
        height, width = self.shape
        x = np.clip(np.arange(strip.first, strip.last) * self.hop - 0.5, 0, width - 1)
        y = np.clip(strip.row * self.hop - 0.5, 0, height - 1)
        return np.stack([x, np.full_like(x, y)], 1)

    def map_strips(self, work: Callable[[Strip], T]) -> Iterator[tuple[Strip, T]]:
        """Yield `work` of every strip, in order, with a few strips under way at once.

        The order makes sums over strips independent of the number of threads.
        """
        if self.threads == 1 or len(self.strips) == 1:
            for strip in self.strips:
                yield strip, work(strip)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            waiting: deque[tuple[Strip, Future[T]]] = deque()
            try:
                for strip in self.strips:
                    waiting.append((strip, pool.submit(work, strip)))
                    if len(waiting) > 2 * self.threads:
                        done, future = waiting.popleft()
                        yield done, future.result()
                while waiting:
                    done, future = waiting.popleft()
                    yield done, future.result()
            finally:
                for _, future in waiting:
                    future.cancel()

    def blocks(self, latent: Image, strip: Strip) -> Image:
        """View the blocks (C, count, N, N) that a strip's patches see of a latent (C, H, W)."""
        origin = self._origin(strip, self.margin - self.radius)
        n = self.block
        covered = _window_of(latent, *origin, n, n + (strip.count - 1) * self.hop)
        view = np.lib.stride_tricks.sliding_window_view(covered, n, axis=2)[:, :, :: self.hop]
        return np.moveaxis(view, 2, 1)

    def patches(self, observed: Image, strip: Strip, window: Image) -> Image:
        """Cut windowed patches of an observed (C, h, w), zero-padded to (C, count, N, N)."""
        origin = self._origin(strip, 0)
        p = self.patch
        covered = _window_of(observed, *origin, p, p + (strip.count - 1) * self.hop)
        view = np.lib.stride_tricks.sliding_window_view(covered, p, axis=2)[:, :, :: self.hop]
        padded = np.zeros((len(observed), strip.count, self.block, self.block), np.float32)
        np.multiply(np.moveaxis(view, 2, 1), window, out=padded[..., :p, :p])
        return padded

    def overlap_add(self, pieces: Image) -> Image:
        """Add up a strip's pieces (C, count, n, n) at every hop, (C, n, n + (count-1) hop)."""
        channels, count, high, wide = pieces.shape
        out = np.zeros((channels, high, wide + (count - 1) * self.hop), np.float32)
        for j in range(count):
            out[:, :, j * self.hop : j * self.hop + wide] += pieces[:, j]
        return out

    def add_observed(self, out: Image, strip: Strip, piece: Image) -> None:
        """Add a strip's patches, overlapped, to an observed image (C, h, w)."""
        _add_at(out, *self._origin(strip, 0), piece)

    def add_latent(self, out: Image, strip: Strip, piece: Image) -> None:
        """Add a strip's blocks, overlapped, to a latent image (C, H, W)."""
        _add_at(out, *self._origin(strip, self.margin - self.radius), piece)

    def rfft(self, blocks: Image) -> Spectrum:
        """Transform blocks (..., N, N) to their spectra."""
        spectrum: Spectrum = scipy.fft.rfft2(blocks, workers=1)
        return spectrum

    def irfft(self, spectra: Spectrum) -> Image:
        """Transform spectra, which may be overwritten, back to blocks (..., N, N)."""
        blocks: Image = scipy.fft.irfft2(
            spectra, (self.block, self.block), workers=1, overwrite_x=True
        )
        return blocks

    def cross_correlations(
        self, observed: Image, latent: Image, reduce: Callable[[Strip, Image], Image]
    ) -> Iterable[tuple[Strip, Image]]:
        """Correlate observed and latent images patch by patch.

        ``cc_p(u) = sum_c sum_i win_p(i) observed_c(i) latent_c(i + u)`` for ``|u| <= r``; `reduce`
        takes a strip and its (count, 2r+1, 2r+1) correlations to what is yielded.
        """

        def work(strip: Strip) -> Image:
            left = self.rfft(self.patches(observed, strip, self.window))
            right = self.rfft(self.blocks(latent, strip))
            summed = np.einsum("cpij,cpij->pij", np.conj(left), right)
            return reduce(strip, self.irfft(summed)[:, : self.reach, : self.reach])

        return self.map_strips(work)

    def autocorrelations(self, observed: Image, strip: Strip) -> Image:
        """Autocorrelate a strip's patches under the root of their windows.

        ``ac_p(v) = sum_c sum_i sqrt(win_p(i) win_p(i+v)) o_c(i) o_c(i+v)``, (count, 4r+1, 4r+1)
        with lag 0 in the middle.
        """
        spectrum = self.rfft(self.patches(observed, strip, np.sqrt(self.window)))
        power = (spectrum.real**2 + spectrum.imag**2).sum(0)
        lags = 2 * self.radius
        rolled = np.roll(self.irfft(power.astype(np.complex64)), (lags, lags), (1, 2))
        return rolled[:, : 2 * lags + 1, : 2 * lags + 1]

    def _origin(self, strip: Strip, offset: int) -> tuple[int, int]:
        """Row and column where a strip begins, plus an offset."""
        return (strip.row - 1) * self.hop + offset, (strip.first - 1) * self.hop + offset


class LocalFilters:
    """One filter per patch: the linear operator and its adjoint.

    Parameters
    ----------
    grid : PatchGrid
        The patches.
    filters : callable
        Takes a strip to its filters (count, 2r+1, 2r+1); called again whenever they are needed,
        unless all spectra fit into 1 GiB and are kept.

    """

    def __init__(self, grid: PatchGrid, filters: Callable[[Strip], Image]) -> None:
        self.grid = grid
        self.filters = filters
        size = 8 * grid.rows * grid.columns * grid.block * (grid.block // 2 + 1)
        self._kept: dict[Strip, Spectrum] | None = {} if size <= _SPECTRA_BYTES else None

    def spectra(self, strip: Strip) -> Spectrum:
        """Return the spectra (count, N, N // 2 + 1) of a strip's filters."""
        if self._kept is not None and strip in self._kept:
            return self._kept[strip]
        grid = self.grid
        padded = np.zeros((strip.count, grid.block, grid.block), np.float32)
        padded[:, : grid.reach, : grid.reach] = self.filters(strip)
        spectra = grid.rfft(padded)
        if self._kept is not None:
            self._kept[strip] = spectra
        return spectra

    def forward(self, latent: Image) -> Image:
        """Filter a latent image (C, H, W) to an observed one (C, h, w)."""
        grid = self.grid

        def work(strip: Strip) -> Image:
            spectra = grid.rfft(grid.blocks(latent, strip))
            spectra *= np.conj(self.spectra(strip))
            pieces = grid.irfft(spectra)[..., : grid.patch, : grid.patch]
            pieces *= grid.window
            return grid.overlap_add(pieces)

        out = np.zeros((len(latent), *grid.shape), np.float32)
        for strip, piece in grid.map_strips(work):
            grid.add_observed(out, strip, piece)
        return out

    def adjoint(self, observed: Image) -> Image:
        """Apply the transpose of `forward` to an observed image (C, h, w), giving (C, H, W)."""
        grid = self.grid

        def work(strip: Strip) -> Image:
            spectra = grid.rfft(grid.patches(observed, strip, grid.window))
            spectra *= self.spectra(strip)
            return grid.overlap_add(grid.irfft(spectra))

        out = np.zeros((len(observed), *grid.latent_shape), np.float32)
        for strip, piece in grid.map_strips(work):
            grid.add_latent(out, strip, piece)
        return out


def channels_first(image: Image) -> Image:
    """View an image (h, w) or (h, w, C) as (C, h, w)."""
    return image[None] if image.ndim == 2 else np.moveaxis(image, -1, 0)  # noqa: PLR2004


def image_like(channels: Image, image: Image) -> Image:
    """View (C, h, w) as an image with as many dimensions as another."""
    return channels[0] if image.ndim == 2 else np.moveaxis(channels, 0, -1)  # noqa: PLR2004


def _window_of(image: Image, top: int, left: int, height: int, width: int) -> Image:
    """Cut a window out of (C, H, W), zero where it reaches beyond the image."""
    y0, y1 = max(top, 0), min(top + height, image.shape[1])
    x0, x1 = max(left, 0), min(left + width, image.shape[2])
    if (y0, y1, x0, x1) == (top, top + height, left, left + width):
        return image[:, y0:y1, x0:x1]
    out = np.zeros((len(image), height, width), np.float32)
    if y1 > y0 and x1 > x0:
        out[:, y0 - top : y1 - top, x0 - left : x1 - left] = image[:, y0:y1, x0:x1]
    return out


def _add_at(image: Image, top: int, left: int, piece: Image) -> None:
    """Add a piece to (C, H, W) at a place, dropping what reaches beyond the image."""
    _, height, width = piece.shape
    y0, y1 = max(top, 0), min(top + height, image.shape[1])
    x0, x1 = max(left, 0), min(left + width, image.shape[2])
    if y1 > y0 and x1 > x0:
        image[:, y0:y1, x0:x1] += piece[:, y0 - top : y1 - top, x0 - left : x1 - left]
