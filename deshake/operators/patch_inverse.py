"""Approximate inverses of a blur with a smoothness term, patch by patch.

For ``M = A^T A + rho D^T D + alpha``, with D the differences of neighbouring pixels:

    P = sum_p block_p' v_p F^-1[ 1 / (|F h_p|^2 + rho |F D|^2 + alpha + floor) ] F u_p block_p

with v_p the window of patch p, and u_p = 1 within the patch. Beyond the patch, u_p fades within the
reach of the filters, because the inverse of a blur reaches far. P is the exact inverse if the blur
is the same over the whole frame, and the frame is a torus. As a preconditioner, it makes one step
as good as many steps without it. P is nearly symmetric. Where the blur changes much from patch to
patch, a step along it is short, and may even lead upwards. A larger alpha prevents this. If the
blur is the same everywhere, one patch without a window is enough, and the latent image with zeros
around it is the torus.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.operators.convolution import Convolution
from deshake.operators.planes import check_size
from deshake.operators.transforms import squared_responses

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from deshake.operators.local_filters import LocalFilters
    from deshake.operators.patches import PatchGrid
    from deshake.operators.strips import Strip

__all__ = ["FourierInverse", "PatchInverse", "approximate_inverse"]

Image = NDArray[np.float32]
Ends = tuple[bool, bool]  # whether a patch is the first, and the last, of its column or row

_FLOOR = np.float32(1e-3)  # least divisor, in powers of a filter of sum 1


def approximate_inverse(blur: Convolution | LocalFilters) -> FourierInverse | PatchInverse:
    """Return the approximate inverse that suits a blur."""
    return FourierInverse(blur) if isinstance(blur, Convolution) else PatchInverse(blur)


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
        self._slopes = grid.transforms.weights(*squared_responses(n, n))
        away = np.arange(n) + 0.5 - grid.radius - grid.patch / 2  # from the patch's centre
        inside = grid.patch / 2 - np.abs(away)
        most = grid.transforms.gain**-0.5  # the two ramps of a window undo the gain
        window = (most * np.clip(inside / grid.ramp, 0, 1)).astype(np.float32)
        beyond = np.clip(1 + inside / max(grid.radius, 1), 0, 1)
        seen = (np.sin(np.pi / 2 * beyond) ** 2).astype(np.float32)

        def planes(full: float, ramp: Image) -> dict[tuple[Ends, Ends], Image]:
            """Return the products (N, N) of two ramps; at the ends of the frame they stay full."""
            ramps = {
                (first, last): np.where(
                    (first & (away < 0)) | (last & (away > 0)), np.float32(full), ramp
                )
                for first in (False, True)
                for last in (False, True)
            }
            return {
                (vertical, horizontal): np.outer(ramps[vertical], ramps[horizontal])
                for vertical in {_ends(i, grid.rows) for i in range(grid.rows)}
                for horizontal in {_ends(i, grid.columns) for i in range(grid.columns)}
            }

        self._seen = planes(1.0, seen)
        self._windows = planes(most, window)

    def means(self, weights: Image) -> Image:
        """Average weights of observed pixels (h, w) patch by patch, as an alpha of `apply`.

        Parameters
        ----------
        weights : (h, w) array of float32
            Weights of the pixels of the frame.

        Returns
        -------
        (rows, columns) array of float32
            The average over the part of each patch within the frame.

        """
        grid = self.filters.grid
        check_size(weights[None], grid.shape)
        down, across = (
            _spans(count, side, grid)
            for count, side in zip((grid.rows, grid.columns), grid.shape, strict=True)
        )
        rows = np.stack([weights[span].mean(0, dtype=np.float64) for span in down])
        return np.stack([rows[:, span].mean(1) for span in across], 1).astype(np.float32)

    def apply(self, latent: Image, rho: ArrayLike, alpha: ArrayLike = 0.0) -> Image:
        """Apply P to a latent image (C, H, W).

        Parameters
        ----------
        latent : (C, H, W) array of float32
            An image with the blur's margin.
        rho : float or (C,) array
            Weight of the smoothness term, >= 0, or that of each plane.
        alpha : float or (rows, columns) array
            Weight of the identity, >= 0, or that of each patch.

        Returns
        -------
        (C, H, W) array of float32

        Raises
        ------
        ValueError
            If the image has another size than the blur's latent images.

        """
        grid, transforms = self.filters.grid, self.filters.grid.transforms
        check_size(latent, grid.latent_shape)
        n = grid.block
        weights, plane = _distinct(rho, len(latent))
        plain = [weight * self._slopes + _FLOOR for weight in weights]
        near = np.broadcast_to(np.asarray(alpha, np.float32), (grid.rows, grid.columns))

        def work(strip: Strip) -> Image:
            spectra, blocks = self.filters.spectra(strip), grid.blocks(latent, strip)
            out = grid.canvas(len(latent), strip, n)
            windowed = grid.padding(len(latent), strip)
            for batch in grid.batches(strip):
                count = batch.stop - batch.start
                row = _ends(strip.row, grid.rows)
                ends = [
                    (row, _ends(strip.first + j, grid.columns)) for j in range(strip.count)[batch]
                ]
                for j, end in enumerate(ends):
                    for block, part in zip(blocks, windowed, strict=True):
                        cv2.multiply(block[batch.start + j], self._seen[end], part[j])
                product = transforms.rfft(windowed[:, :count])
                power = transforms.power(spectra[batch])
                power += near[strip.row, strip.first : strip.last][batch, None, None]
                for i, smoothness in enumerate(plain):
                    inverse = power + smoothness
                    np.reciprocal(inverse, out=inverse)
                    for c in np.flatnonzero(plane == i):
                        transforms.weigh(product[c], inverse)
                pieces = transforms.irfft(product)
                for j, end in enumerate(ends):
                    grid.overlap_add(pieces[:, j : j + 1], out, batch.start + j, self._windows[end])
            return out

        out = np.zeros((len(latent), *grid.latent_shape), np.float32)
        for strip, piece in grid.map_strips(work):
            grid.add_latent(out, strip, piece)
        return out


class FourierInverse:
    """The map P for one filter of the whole frame, on the torus of the blur.

    Parameters
    ----------
    filters : Convolution
        The blur A.

    """

    def __init__(self, filters: Convolution) -> None:
        self.filters = filters
        down, self._across = squared_responses(*filters.torus)
        self._down = down[:, None]

    def means(self, weights: Image) -> Image:
        """Average weights of observed pixels (h, w): there is one patch, (1, 1)."""
        return np.full((1, 1), weights.mean(dtype=np.float64), np.float32)

    def apply(self, latent: Image, rho: ArrayLike, alpha: ArrayLike = 0.0) -> Image:
        """Apply P to a latent image (C, H, W), as `PatchInverse.apply` does."""
        blur = self.filters
        check_size(latent, blur.latent_shape)
        weights, plane = _distinct(rho, len(latent))
        out = np.empty((len(latent), *blur.latent_shape), np.float32)
        for i, weight in enumerate(weights):
            inverse = np.square(blur.spectrum.real)
            inverse += np.square(blur.spectrum.imag)
            inverse += weight * self._down + (np.asarray(alpha, np.float32) + _FLOOR)
            inverse += weight * self._across
            np.reciprocal(inverse, out=inverse)
            for c in np.flatnonzero(plane == i):
                product = blur.rfft(latent[c])
                product *= inverse
                out[c] = blur.irfft(product, blur.latent_shape)
        return out


def _spans(count: int, side: int, grid: PatchGrid) -> list[slice]:
    """Return the parts of a side of the frame that each patch of a row or column covers."""
    first = np.arange(count) * grid.hop - grid.ramp
    return [slice(max(at, 0), min(at + grid.patch, side)) for at in first.tolist()]


def _ends(index: int, count: int) -> Ends:
    """Return the ends of a column or row of patches that a patch is at."""
    return index == 0, index == count - 1


def _distinct(rho: ArrayLike, channels: int) -> tuple[Image, NDArray[np.intp]]:
    """Return the distinct weights of the planes, and which of them each plane has."""
    planes = np.broadcast_to(np.asarray(rho, np.float32), channels)
    weights, plane = np.unique(planes, return_inverse=True)
    return weights, plane
