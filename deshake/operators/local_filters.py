"""One filter for each patch of the frame: a linear operator and its adjoint, through FFTs."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import check_size

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.operators.patches import PatchGrid
    from deshake.operators.strips import Strip
    from deshake.operators.transforms import Spectra

__all__ = ["LocalFilters"]

Image = NDArray[np.float32]

_KEPT_BYTES = 768 << 20  # bytes of filters and spectra that are kept, by default


class LocalFilters:
    """One filter per patch: the linear operator and its adjoint.

    Filters and spectra are computed at the first need, and kept within the budget. The filters of
    all strips come before any spectrum, since they are smaller, and cost more for a blur of many
    rotations. Those not kept are computed again each time, with the same result.

    Parameters
    ----------
    grid : PatchGrid
        The patches.
    filters : callable
        Returns the filters (count, 2r+1, 2r+1) of a strip, in float32.
    budget : int
        Bytes that filters and spectra may fill together.

    """

    def __init__(
        self, grid: PatchGrid, filters: Callable[[Strip], Image], *, budget: int = _KEPT_BYTES
    ) -> None:
        self.grid = grid
        self._work_out = filters
        self._filters: dict[Strip, Image] = {}
        self._spectra: dict[Strip, Spectra] = {}
        self._keep_filters, self._keep_spectra = self._plan(budget)

    def near(self, marked: NDArray[np.bool_]) -> LocalFilters:
        """Return the same operator on those patches alone that depend on marked latent pixels.

        Its adjoint is right at the marked pixels. Its forward map is right at the observed pixels
        that the marked pixels reach. Elsewhere both are incomplete.

        Parameters
        ----------
        marked : (H, W) array of bool
            Pixels of the latent image.

        Raises
        ------
        ValueError
            If the array has another size than the grid's latent images.

        """
        part = copy(self)
        part.grid = self.grid.near(marked)
        return part

    def _plan(self, budget: int) -> tuple[frozenset[Strip], frozenset[Strip]]:
        """Choose the strips whose filters are kept, and those whose spectra are kept."""
        strips = self.grid.strips
        filters = [4 * strip.count * self.grid.reach**2 for strip in strips]
        spectra = [strip.count * self.grid.transforms.nbytes for strip in strips]
        left, kept = budget - sum(filters), 0
        # a strip whose spectra are kept needs its filters no longer
        while kept < len(strips) and left >= spectra[kept] - filters[kept]:
            left -= spectra[kept] - filters[kept]
            kept += 1
        if left >= 0:
            return frozenset(strips[kept:]), frozenset(strips[:kept])
        first = int(np.searchsorted(np.cumsum(filters), budget, "right"))
        return frozenset(strips[:first]), frozenset()

    def filters(self, strip: Strip) -> Image:
        """Return the filters (count, 2r+1, 2r+1) of a strip's patches."""
        if strip in self._filters:
            return self._filters[strip]
        filters = self._work_out(strip)
        if strip in self._keep_filters:
            self._filters[strip] = filters
        return filters

    def spectra(self, strip: Strip) -> Spectra:
        """Return the spectra (count, N, M) of a strip's filters."""
        if strip in self._spectra:
            return self._spectra[strip]
        spectra = self.grid.transforms.rfft(self.filters(strip))
        if strip in self._keep_spectra:
            self._spectra[strip] = spectra
        return spectra

    def forward(self, latent: Image) -> Image:
        """Filter a latent image (C, H, W) to an observed one (C, h, w).

        Raises
        ------
        ValueError
            If the image has another size than the grid's latent images.

        """
        grid, transforms = self.grid, self.grid.transforms
        check_size(latent, grid.latent_shape)
        channels = len(latent)

        def work(strip: Strip) -> Image:
            spectra, blocks = self.spectra(strip), grid.blocks(latent, strip)
            out = grid.canvas(channels, strip, grid.patch)
            for batch in grid.batches(strip):
                product = transforms.rfft(blocks[:, batch])
                transforms.multiply(product, spectra[batch], conjugate=True)
                pieces = transforms.irfft(product, grid.patch)
                grid.overlap_add(pieces, out, batch.start, grid.window)
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
        grid, transforms = self.grid, self.grid.transforms
        check_size(observed, grid.shape)
        channels = len(observed)
        size = grid.patch + 2 * grid.radius

        def work(strip: Strip) -> Image:
            spectra, patches = self.spectra(strip), grid.patches(observed, strip)
            padding = grid.padding(channels, strip)
            out = grid.canvas(channels, strip, size)
            for batch in grid.batches(strip):
                product = transforms.rfft(grid.padded(patches[:, batch], padding))
                transforms.multiply(product, spectra[batch])
                grid.overlap_add(transforms.irfft(product, size), out, batch.start)
            return out

        out = np.zeros((channels, *grid.latent_shape), np.float32)
        for strip, piece in grid.map_strips(work):
            grid.add_latent(out, strip, piece)
        return out
