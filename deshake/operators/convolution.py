"""Uniform blur: one filter for the whole frame, through one FFT of it.

If every rotation moves the whole frame alike, filter flow has the same filter in every patch, and
needs no windows. With f zero beyond the latent image, and a torus so large that nothing wraps
around,

    forward   g = F^-1[ F f conj(F h) ],     adjoint   f = F^-1[ F g F h ]

are exact. The filter lies on the torus so that both images begin at its origin.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from deshake.operators.planes import check_size
from deshake.run import Run

__all__ = ["Convolution"]

Image = NDArray[np.float32]
Spectrum = NDArray[np.complex64]


class Convolution:
    """One filter for the whole frame: the linear operator and its adjoint.

    Parameters
    ----------
    h : (2r+1, 2r+1) array of float32
        The filter: ``g(i) = sum_u h(r + u) f(i + u)``, rows first.
    shape : (int, int)
        Height and width of the observed frame in pixels.
    margin : int
        Pixels by which latent images are larger on every side. Beyond them all is zero.
    run : Run, optional
        Threads to use. The result does not depend on them.

    """

    def __init__(self, h: Image, shape: tuple[int, int], margin: int, *, run: Run = Run()) -> None:
        self.shape = shape
        self.margin = margin
        self.run = run
        radius = len(h) // 2
        wide = margin + max(margin, radius)
        self.torus: tuple[int, int] = (
            scipy.fft.next_fast_len(shape[0] + wide, real=True),
            scipy.fft.next_fast_len(shape[1] + wide, real=True),
        )
        rows, columns = ((np.arange(len(h)) + margin - radius) % side for side in self.torus)
        placed = np.zeros(self.torus, np.float32)
        placed[np.ix_(rows, columns)] = h
        self.spectrum = self.rfft(placed)

    @property
    def latent_shape(self) -> tuple[int, int]:
        """Height and width of latent images in pixels."""
        return self.shape[0] + 2 * self.margin, self.shape[1] + 2 * self.margin

    def near(self, marked: NDArray[np.bool_]) -> Convolution:
        """Return this operator: it has no patches, and is right near all marked pixels (H, W).

        Raises
        ------
        ValueError
            If the array has another size than latent images have.

        """
        check_size(marked[None], self.latent_shape)
        return self

    def forward(self, latent: Image) -> Image:
        """Filter a latent image (C, H, W) to an observed one (C, h, w).

        Raises
        ------
        ValueError
            If the image has another size than latent images have.

        """
        check_size(latent, self.latent_shape)
        out = np.empty((len(latent), *self.shape), np.float32)
        for plane, blurred in zip(latent, out, strict=True):
            product = self.rfft(plane, conjugate=True)
            product *= self.spectrum
            blurred[...] = self.irfft(product, self.shape, conjugate=True)
        return out

    def adjoint(self, observed: Image) -> Image:
        """Apply the transpose of `forward` to an observed image (C, h, w), giving (C, H, W).

        Raises
        ------
        ValueError
            If the image has another size than observed ones have.

        """
        check_size(observed, self.shape)
        out = np.empty((len(observed), *self.latent_shape), np.float32)
        for plane, back in zip(observed, out, strict=True):
            product = self.rfft(plane)
            product *= self.spectrum
            back[...] = self.irfft(product, self.latent_shape)
        return out

    def rfft(self, plane: Image, *, conjugate: bool = False) -> Spectrum:
        """Transform an image, zero-padded to the torus, to its (conjugate) spectrum."""
        n, m = self.torus
        spectrum: Spectrum
        if conjugate:  # transforms of the other sign: cheaper than to conjugate afterwards
            rows = scipy.fft.ihfft(plane, m, norm="forward", workers=self.run.workers)
            spectrum = scipy.fft.ifft(
                rows, n, axis=0, norm="forward", overwrite_x=True, workers=self.run.workers
            )
        else:
            rows = scipy.fft.rfft(plane, m, workers=self.run.workers)
            spectrum = scipy.fft.fft(rows, n, axis=0, overwrite_x=True, workers=self.run.workers)
        return spectrum

    def irfft(
        self, spectrum: Spectrum, shape: tuple[int, int], *, conjugate: bool = False
    ) -> Image:
        """Transform a (conjugate) spectrum, which is overwritten, to the first rows and columns."""
        height, width = shape
        m = self.torus[1]
        plane: Image
        if conjugate:
            rows = scipy.fft.fft(
                spectrum, axis=0, norm="forward", overwrite_x=True, workers=self.run.workers
            )
            plane = scipy.fft.hfft(rows[:height], m, norm="forward", workers=self.run.workers)
        else:
            rows = scipy.fft.ifft(spectrum, axis=0, overwrite_x=True, workers=self.run.workers)
            plane = scipy.fft.irfft(rows[:height], m, workers=self.run.workers)
        return plane[:, :width]
