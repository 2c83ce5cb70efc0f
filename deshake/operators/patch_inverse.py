"""An approximate inverse of filter flow with a smoothness term, patch by patch.

For ``M = A^T A + rho D^T D``, with D the differences of neighbouring pixels:

    P = sum_p block_p' v_p F^-1[ 1 / (|F h_p|^2 + rho |F D|^2 + floor) ] F v_p block_p

with v_p the root of patch p's window, is symmetric and positive. Were the blur the same all over
the frame, and the frame a torus, it would be the inverse; as a preconditioner one step with it does
the work of many without.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import check_size

if TYPE_CHECKING:
    from deshake.operators.local_filters import LocalFilters
    from deshake.operators.strips import Strip

__all__ = ["PatchInverse"]

Image = NDArray[np.float32]

_FLOOR = np.float32(1e-4)


class PatchInverse:
    """The map P for the local filters of a blur.

    Parameters
    ----------
    filters : LocalFilters
        The blur A, one filter for each patch.

    """

    def __init__(self, filters: LocalFilters) -> None:
        self.filters = filters
        grid = filters.grid
        n = grid.block
        down = np.sin(np.pi * np.fft.fftfreq(n))[:, None]
        across = np.sin(np.pi * np.fft.rfftfreq(n))
        self._slopes = (4 * (down**2 + across**2)).astype(np.float32)
        away = (np.arange(n) + 0.5 - grid.radius - grid.hop) / grid.hop  # from the patch's middle
        ramp = np.sqrt(np.clip(1 - np.abs(away), 0, 1)).astype(np.float32)
        # by row or column: inner ones fade both ways, the first and the last reach on outwards
        self._ramps = {
            (first, last): np.where((first & (away < 0)) | (last & (away > 0)), np.float32(1), ramp)
            for first in (False, True)
            for last in (False, True)
        }

    def apply(self, latent: Image, rho: float) -> Image:
        """Apply P to a latent image (C, H, W).

        Parameters
        ----------
        latent : (C, H, W) array of float32
            An image with the blur's margin.
        rho : float
            Weight of the smoothness term, >= 0.

        Returns
        -------
        (C, H, W) array of float32

        Raises
        ------
        ValueError
            If the image has another size than the blur's latent images.

        """
        grid = self.filters.grid
        check_size(latent, grid.latent_shape)
        n = grid.block
        plain = np.float32(rho) * self._slopes + _FLOOR

        def work(strip: Strip) -> Image:
            spectra = self.filters.spectra(strip)
            down = self._ramp(strip.row, grid.rows)[:, None]
            out = np.zeros((len(latent), n, n + (strip.count - 1) * grid.hop), np.float32)
            for batch in grid.batches(strip):
                part = strip.part(batch.start, batch.stop)
                columns = range(part.first, part.last)
                window = down * np.stack([self._ramp(j, grid.columns) for j in columns])[:, None]
                product = grid.rfft(grid.blocks(latent, part) * window)
                some = spectra[batch]
                product /= np.square(some.real) + np.square(some.imag) + plain
                pieces = grid.irfft(product)
                pieces *= window
                grid.overlap_add(pieces, out, batch.start)
            return out

        out = np.zeros((len(latent), *grid.latent_shape), np.float32)
        for strip, piece in grid.map_strips(work):
            grid.add_latent(out, strip, piece)
        return out

    def _ramp(self, index: int, count: int) -> Image:
        """Root of the window along a row or a column of patches, (N,)."""
        return self._ramps[index == 0, index == count - 1]
