"""One filter for each patch of the frame: a linear operator and its adjoint, through FFTs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import check_size

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.operators.patches import PatchGrid
    from deshake.operators.strips import Strip

__all__ = ["LocalFilters"]

Image = NDArray[np.float32]
Spectrum = NDArray[np.complex64]

_SPECTRA_BYTES = 1 << 30  # spectra are kept up to this size, and recomputed beyond it


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
        spectra = self.grid.rfft(self.filters(strip))
        if self._kept is not None:
            self._kept[strip] = spectra
        return spectra

    def forward(self, latent: Image) -> Image:
        """Filter a latent image (C, H, W) to an observed one (C, h, w).

        Raises
        ------
        ValueError
            If the image has another size than the grid's latent images.

        """
        grid = self.grid
        check_size(latent, grid.latent_shape)
        channels = len(latent)

        def work(strip: Strip) -> Image:
            spectra = self.spectra(strip)
            wide = grid.patch + (strip.count - 1) * grid.hop
            out = np.zeros((channels, grid.patch, wide), np.float32)
            for batch in grid.batches(strip):
                part = strip.part(batch.start, batch.stop)
                product = grid.rfft(grid.blocks(latent, part), conjugate=True)
                product *= spectra[batch]
                pieces = grid.irfft(product, grid.patch, conjugate=True)
                pieces *= grid.window
                grid.overlap_add(pieces, out, batch.start)
            return out

        out = np.zeros((channels, *grid.shape), np.float32)
        for strip, piece in grid.map_strips(work):
            grid.add_observed(out, strip, piece)
        return out

    def adjoint(self, observed: Image) -> Image:
        """Apply the transpose of `forward` to an observed image (C, h, w), giving (C, H, W).

        Raises
        ------
        ValueError
            If the image has another size than the grid's observed images.

        """
        grid = self.grid
        check_size(observed, grid.shape)
        channels = len(observed)
        size = grid.patch + 2 * grid.radius

        def work(strip: Strip) -> Image:
            spectra = self.spectra(strip)
            wide = size + (strip.count - 1) * grid.hop
            out = np.zeros((channels, size, wide), np.float32)
            for batch in grid.batches(strip):
                part = strip.part(batch.start, batch.stop)
                product = grid.rfft(grid.patches(observed, part, grid.window))
                product *= spectra[batch]
                grid.overlap_add(grid.irfft(product, size), out, batch.start)
            return out

        out = np.zeros((channels, *grid.latent_shape), np.float32)
        for strip, piece in grid.map_strips(work):
            grid.add_latent(out, strip, piece)
        return out
