"""What changes fast with the frequency in the spectra of tiles.

Spectra are those of real pictures: the value at a frequency and at its negative is the same. So one
half of the plane is enough, (P, N, N // 2 + 1), with N even. A box filter on it sees the values of
the other half, as if the plane were whole and periodic. In sums, a frequency whose negative is in
the other half counts twice.

The fluctuations of a spectrum are what a box filter, applied twice, leaves of it within a band of
frequencies. A long edge makes a bright line through the origin of the spectrum. So the mean along
each such line is subtracted. Fluctuations are listed line by line, (P, F).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Fluctuations", "box_filtered"]

Image = NDArray[np.float32]


class Fluctuations:
    """The fluctuations of spectra of one size.

    Parameters
    ----------
    size : int
        Side N of the tiles in pixels, even.
    band : (float, float)
        Slowest and fastest frequency that counts, in cycles per pixel; the fastest is below 0.5.
    side : int
        Side of the box filter in frequencies, odd.

    """

    def __init__(self, size: int, band: tuple[float, float], side: int) -> None:
        self.shape = size, size // 2 + 1
        self.side = side
        down, across = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)
        radius = np.hypot(down, across)
        inside = np.flatnonzero((radius > band[0]) & (radius < band[1]))
        turn = np.mod(np.arctan2(down, across), np.pi) / np.pi
        line = np.minimum((turn * size).astype(np.int64), size - 1).ravel()
        self._places = inside[np.argsort(line[inside], kind="stable")]
        _, self._first, self._lengths = np.unique(
            line[self._places], return_index=True, return_counts=True
        )
        self.counts: Image = np.where(self._places % self.shape[1], 2, 1).astype(np.float32)
        self._line_counts = np.add.reduceat(self.counts, self._first)

    def of(self, spectra: Image) -> Image:
        """Return the fluctuations (P, F) of spectra (P, N, N // 2 + 1)."""
        rest = spectra - box_filtered(spectra, self.side, 2)
        return self.off_lines(rest.reshape(len(rest), -1).take(self._places, 1))

    def adjoint(self, values: Image) -> Image:
        """Return the adjoint of `of` for values (P, F) whose means along all lines are zero."""
        spectra = np.zeros((len(values), *self.shape), np.float32)
        spectra.reshape(len(values), -1)[:, self._places] = values
        spectra -= box_filtered(spectra, self.side, 2)
        return spectra

    def off_lines(self, values: Image) -> Image:
        """Subtract the mean along each line, in place; return the values (P, F)."""
        sums = np.add.reduceat(values * self.counts, self._first, axis=1)
        sums /= self._line_counts
        values -= sums.repeat(self._lengths, axis=1)
        return values

    def product(self, one: Image, other: Image) -> float:
        """Return the inner product of values (P, F) over the whole plane."""
        return float(np.vdot(one * self.counts, other))


def box_filtered(spectra: Image, side: int, times: int = 1) -> Image:
    """Apply a box filter of an odd side to spectra (P, N, N // 2 + 1), one or more times."""
    count, rows, columns = spectra.shape
    r = side // 2 * times
    around = np.empty((count, rows + 2 * r, columns + 2 * r), np.float32)
    middle = around[:, r:-r]
    middle[..., r:-r] = spectra
    for beyond, mirrored in (
        (middle[..., :r], spectra[..., r:0:-1]),
        (middle[..., -r:], spectra[..., -2 : -2 - r : -1]),
    ):
        beyond[:, 0] = mirrored[:, 0]
        beyond[:, 1:] = mirrored[:, :0:-1]
    around[:, :r] = around[:, rows : rows + r]
    around[:, -r:] = around[:, r : 2 * r]
    tall = around.reshape(-1, columns + 2 * r)  # rows of other tiles reach only the rows cut off
    line = np.ones(1)
    for _ in range(times):
        line = np.convolve(line, np.full(side, 1 / side))
    blurred = cv2.sepFilter2D(tall, cv2.CV_32F, line, line)  # in half the time of `cv2.blur`
    return np.asarray(blurred, np.float32).reshape(around.shape)[:, r:-r, r:-r]
