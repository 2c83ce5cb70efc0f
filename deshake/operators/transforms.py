"""Fourier transforms of square blocks, by the library that is faster on the machine.

With Intel's primitives, OpenCV transforms a large block in about two thirds of SciPy's time;
without them it needs two to three times that. SciPy transforms many small blocks in one call. Each
library has its own layout of spectra: complex, or packed into as many real numbers as the block has
pixels. So only `Transforms` reads them; callers pass them from one method to another.
"""

from __future__ import annotations

from functools import cache, cached_property
from typing import Any, Protocol

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

__all__ = [
    "ComplexTransforms",
    "PackedTransforms",
    "Spectra",
    "Transforms",
    "power_of",
    "squared_responses",
    "transforms",
]

Image = NDArray[np.float32]
Spectrum = NDArray[np.complex64]
Spectra = NDArray[Any]
"""Spectra of blocks, (..., N, M): complex64 or float32."""

_ONE_BY_ONE = 100  # px: least side of blocks that get a call each
_CACHED = 320  # px: largest side of blocks whose transforms stay in the cache
_BEYOND_SCIPY, _BEYOND_OPENCV = 1.2, 1.1  # factors of the time a pixel for larger blocks
_POWER_OF_TWO = 0.84  # factor of the time a pixel, with OpenCV
_EVEN_STEP = 4  # packed lengths are multiples of it: others take longer


class Transforms(Protocol):
    """Transforms of blocks of N x N pixels.

    Spectra of images have the shape (C, count, N, M), those of filters (count, N, M), and weights
    of frequencies (count, N, M) or (N, M). M and the type depend on the library.
    """

    length: int
    nbytes: int
    """Bytes of a spectrum."""
    effort: float
    """Time of a block; a unit is the time of a pixel of a small block."""
    gain: int
    """Factor of the blocks that `irfft` returns."""

    def rfft(self, blocks: Image) -> Spectra:
        """Transform blocks (..., n, n), n <= N, with zeros below and to the right of them."""

    def irfft(self, spectra: Spectra, size: int | None = None) -> Image:
        """Transform spectra back to blocks; keep (..., size, size). The spectra are lost.

        The blocks are `gain` times too bright. A window that they are multiplied by anyway can
        contain its inverse, which then takes no time.
        """

    def multiply(self, spectra: Spectra, filters: Spectra, *, conjugate: bool = False) -> None:
        """Multiply the spectra of images by those of (conjugate) filters, in place."""

    def power(self, filters: Spectra) -> Image:
        """Return ``|F h|^2``, to weigh frequencies with."""

    def weights(self, down: Image, across: Image) -> Image:
        """Add weights of the frequencies down (N,) and across (N // 2 + 1,): (N, M)."""

    def weigh(self, spectra: Spectra, weights: Image) -> None:
        """Multiply spectra (count, N, M) by weights of the frequencies, in place."""

    def add(self, spectra: Spectra, weights: Image) -> None:
        """Add weights of the frequencies to spectra (count, N, M), in place."""


@cache
def transforms(least: int) -> Transforms:
    """Return the transforms of blocks of a fast size: N is at least `least`."""
    one_by_one = least >= _ONE_BY_ONE and cv2.ipp.useIPP()
    return PackedTransforms(least) if one_by_one else ComplexTransforms(least)


def squared_responses(rows: int, columns: int) -> tuple[Image, Image]:
    """Squared responses of the differences between neighbours, on a torus.

    That of the lower neighbour at the frequencies down, (N,), and that of the right neighbour at
    the frequencies across, (M // 2 + 1,).
    """
    down = 4 * np.sin(np.pi * np.fft.fftfreq(rows)) ** 2
    across = 4 * np.sin(np.pi * np.fft.rfftfreq(columns)) ** 2
    return down.astype(np.float32), across.astype(np.float32)


def power_of(spectra: Spectrum) -> Image:
    """Return the power of complex spectra."""
    power: Image = spectra.real**2
    power += spectra.imag**2
    return power


class ComplexTransforms:
    """Transforms by SciPy: complex spectra of half the frequencies across."""

    def __init__(self, least: int) -> None:
        self.length: int = scipy.fft.next_fast_len(least, real=True)
        self.nbytes = 8 * self.length * (self.length // 2 + 1)
        self.effort = _effort(self.length, _BEYOND_SCIPY)
        self.gain = 1

    def rfft(self, blocks: Image) -> Spectrum:
        """See `Transforms.rfft`."""
        n = self.length
        rows = scipy.fft.rfft(blocks, n, workers=1)
        spectra: Spectrum = scipy.fft.fft(rows, n, axis=-2, overwrite_x=True, workers=1)
        return spectra

    def irfft(self, spectra: Spectrum, size: int | None = None) -> Image:
        """See `Transforms.irfft`."""
        n = size or self.length
        rows = scipy.fft.ifft(spectra, axis=-2, overwrite_x=True, workers=1)
        blocks: Image = scipy.fft.irfft(rows[..., :n, :], self.length, workers=1)[..., :n]
        return blocks

    def multiply(self, spectra: Spectrum, filters: Spectrum, *, conjugate: bool = False) -> None:
        """See `Transforms.multiply`."""
        _multiply(spectra, filters, conjugate=conjugate)

    def power(self, filters: Spectrum) -> Image:
        """See `Transforms.power`."""
        return power_of(filters)

    def weights(self, down: Image, across: Image) -> Image:
        """See `Transforms.weights`."""
        both: Image = down[:, None] + across
        return both

    def weigh(self, spectra: Spectrum, weights: Image) -> None:
        """See `Transforms.weigh`."""
        spectra *= weights.astype(np.complex64)  # faster than by real numbers

    def add(self, spectra: Spectrum, weights: Image) -> None:
        """See `Transforms.add`."""
        spectra += weights


class PackedTransforms:
    """Transforms by OpenCV: real and imaginary parts side by side, without redundant ones.

    Columns 1 and 2, 3 and 4 and so on hold the real and the imaginary parts of the frequencies
    1, 2 ... across. Column 0 and the last one hold those of 0 and N / 2, with both parts below each
    other in the same order. N is even.
    """

    def __init__(self, least: int) -> None:
        n = -(-least // _EVEN_STEP)
        # the prime factors 17 and above would take two to three times as long
        self.length: int = _EVEN_STEP * scipy.fft.next_fast_len(n)
        self.nbytes = 4 * self.length**2
        self.effort = _effort(self.length, _BEYOND_OPENCV)
        if self.length & (self.length - 1) == 0:
            self.effort *= _POWER_OF_TWO
        self.gain = self.length**2

    def rfft(self, blocks: Image) -> Image:
        """See `Transforms.rfft`."""
        n = self.length
        *count, height, width = blocks.shape
        spectra = np.empty((*count, n, n), np.float32)
        if (height, width) == (n, n):
            for at in np.ndindex(*count):
                cv2.dft(blocks[at], spectra[at])
            return spectra
        padded = np.zeros((n, n), np.float32)
        for at in np.ndindex(*count):
            padded[:height, :width] = blocks[at]
            cv2.dft(padded, spectra[at])
        return spectra

    def irfft(self, spectra: Image, size: int | None = None) -> Image:
        """See `Transforms.irfft`."""
        for at in np.ndindex(*spectra.shape[:-2]):
            cv2.dft(spectra[at], spectra[at], cv2.DFT_INVERSE)
        blocks: Image = spectra[..., :size, :size]
        return blocks

    def multiply(self, spectra: Image, filters: Image, *, conjugate: bool = False) -> None:
        """See `Transforms.multiply`."""
        ends, ends_h = _ends(spectra).copy(), _ends(filters).copy()
        _multiply(_pairs(spectra), _pairs(filters), conjugate=conjugate)
        _multiply(_column_pairs(ends), _column_pairs(ends_h), conjugate=conjugate)
        _ends(ends)[...] *= _ends(ends_h)
        _ends(spectra)[...] = ends

    def power(self, filters: Image) -> Image:
        """See `Transforms.power`."""
        power = filters.copy()
        self.multiply(power, filters, conjugate=True)
        ends = _ends(power).copy()
        # put the power in the imaginary part, too
        _pairs(power)[...] *= np.complex64(1 + 1j)
        _column_pairs(ends)[...] *= np.complex64(1 + 1j)
        _ends(power)[...] = ends
        return power

    def weights(self, down: Image, across: Image) -> Image:
        """See `Transforms.weights`."""
        halves = (np.arange(self.length) + 1) // 2  # frequencies 0, 1, 1, 2, 2, ..., N / 2
        both: Image = down[:, None] + across[halves]
        for column in (0, -1):
            both[:, column] = down[halves] + across[column]
        return both

    def weigh(self, spectra: Image, weights: Image) -> None:
        """See `Transforms.weigh`."""
        spectra *= weights

    def add(self, spectra: Image, weights: Image) -> None:
        """See `Transforms.add`."""
        spectra += weights * self._real

    @cached_property
    def _real(self) -> Image:
        """1 for each real part, and 0 for each imaginary part."""
        alone = np.zeros(self.length, np.float32)
        alone[0] = alone[1::2] = 1
        real = np.tile(alone, (self.length, 1))
        real[:, 0] = real[:, -1] = alone
        return real


def _effort(length: int, beyond: float) -> float:
    """Return the pixels of a block, times a factor if it leaves the cache."""
    return length**2 * (beyond if length > _CACHED else 1)


def _multiply(spectra: Spectrum, filters: Spectrum, *, conjugate: bool) -> None:
    """Multiply complex numbers by (conjugate) others, in place."""
    spectra *= np.conj(filters) if conjugate else filters


def _ends(spectra: Image) -> Image:
    """View the first and the last column of packed spectra (..., N, M) as rows, (..., 2, N)."""
    return spectra[..., :: spectra.shape[-1] - 1].swapaxes(-1, -2)


def _pairs(spectra: Image) -> Spectrum:
    """View packed spectra (..., count, N, N), C-contiguous, as complex numbers in one row.

    NumPy multiplies one row much faster than many short ones. The pairs of neighbours that lie in
    two rows are no frequencies.
    """
    pairs: Spectrum = spectra.reshape(*spectra.shape[:-3], -1)[..., 1:-1].view(np.complex64)
    return pairs


def _column_pairs(ends: Image) -> Spectrum:
    """View the pairs of real and imaginary parts of `_ends` as complex numbers."""
    pairs: Spectrum = ends[..., 1:-1].view(np.complex64)
    return pairs
