"""Fourier transforms of square blocks, by the library that is faster on the machine.

With Intel's primitives, OpenCV transforms a large block in about two thirds of SciPy's time;
without them it needs two to three times that. SciPy transforms many small blocks in one call. Each
library has its own layout of spectra: complex, or packed into as many real numbers as the block has
pixels. So only `Transforms` reads them; callers pass them from one method to another.
"""

from __future__ import annotations

from functools import cache
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
    "transforms",
]

Image = NDArray[np.float32]
Spectrum = NDArray[np.complex64]
Spectra = NDArray[Any]
"""Spectra of blocks, (..., N, M): complex64 or float32."""

_ONE_BY_ONE = 100  # px: least side of blocks that get a call each
_EVEN_STEP = 8  # packed lengths are multiples of it: others take up to 1.5 times as long


class Transforms(Protocol):
    """Transforms of blocks of N x N pixels.

    Spectra of images have the shape (C, count, N, M), those of filters (count, N, M), and weights
    of frequencies (count, N, M) or (N, M). M and the type depend on the library.
    """

    length: int
    nbytes: int
    """Bytes of a spectrum."""

    def rfft(self, blocks: Image) -> Spectra:
        """Transform blocks (..., n, n), n <= N, with zeros below and to the right of them."""

    def irfft(self, spectra: Spectra, size: int | None = None) -> Image:
        """Transform spectra back to blocks; keep (..., size, size). The spectra are lost."""

    def multiply(self, spectra: Spectra, filters: Spectra, *, conjugate: bool = False) -> None:
        """Multiply the spectra of images by those of (conjugate) filters, in place."""

    def power(self, filters: Spectra) -> Image:
        """Return ``|F h|^2``, to weigh frequencies with."""

    def weights(self, down: Image, across: Image) -> Image:
        """Add weights of the frequencies down (N,) and across (N // 2 + 1,): (N, M)."""

    def weigh(self, spectra: Spectra, weights: Image) -> None:
        """Multiply spectra (count, N, M) by weights of the frequencies, in place."""


@cache
def transforms(least: int) -> Transforms:
    """Return the transforms of blocks of a fast size: N is at least `least`."""
    one_by_one = least >= _ONE_BY_ONE and cv2.ipp.useIPP()
    return PackedTransforms(least) if one_by_one else ComplexTransforms(least)


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
        spectra *= np.conj(filters) if conjugate else filters

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


class PackedTransforms:
    """Transforms by OpenCV: real and imaginary parts side by side, without redundant ones.

    Columns 1 and 2, 3 and 4 and so on hold the real and the imaginary parts of the frequencies
    1, 2 ... across. Column 0 and the last one hold those of 0 and N / 2, with both parts below each
    other in the same order. N is even.
    """

    def __init__(self, least: int) -> None:
        n = -(-least // _EVEN_STEP)
        self.length: int = _EVEN_STEP * scipy.fft.next_fast_len(n, real=True)
        self.nbytes = 4 * self.length**2

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
            cv2.dft(spectra[at], spectra[at], cv2.DFT_INVERSE | cv2.DFT_SCALE)
        blocks: Image = spectra[..., :size, :size]
        return blocks

    def multiply(self, spectra: Image, filters: Image, *, conjugate: bool = False) -> None:
        """See `Transforms.multiply`."""
        filters = np.broadcast_to(filters, spectra.shape)
        for at in np.ndindex(*spectra.shape[:-2]):
            cv2.mulSpectrums(spectra[at], filters[at], 0, spectra[at], conjB=conjugate)

    def power(self, filters: Image) -> Image:
        """See `Transforms.power`."""
        power = np.empty_like(filters)
        for at in np.ndindex(*filters.shape[:-2]):
            cv2.mulSpectrums(filters[at], filters[at], 0, power[at], conjB=True)
        power[..., 2:-1:2] = power[..., 1:-2:2]
        for column in (0, -1):
            power[..., 2:-1:2, column] = power[..., 1:-2:2, column]
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
