"""How well the spectra of a photo match a kernel, and the camera path that they match best.

Where the filter H of a blur has a zero in the frequency domain, the power of the photo is low,
whatever the scene. The power of most scenes changes slowly with the frequency. So the log power of
the photo fluctuates as ``ln |H|^2`` does, with noise added. The match is the correlation of the
two. It needs no estimate of the sharp picture, it is high only for kernels that are nearly right,
and it changes smoothly with the path of the camera. So a descent that begins at a path that is
nearly right ends much nearer to the true path. A method that estimates the sharp picture and the
kernel in turn ends farther from it, because an error of one hides an error of the other.

A scene has fluctuations of its own. Their mean along each line through the origin of the spectrum
does not count (`fluctuations`), and large ones count only up to a bound.

The power is the same for a kernel and for its reflection about its centroid. The judge tells them
apart.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from deshake.blind.camera_path import SmoothPath, price_of_bends
from deshake.blind.descent import descent
from deshake.blind.fluctuations import Fluctuations, box_filtered
from deshake.blind.settings import SETTINGS, SpectrumTiles
from deshake.blind.tile_choice import covering
from deshake.blind.tile_plan import informative_corners
from deshake.blind.trimming import heaviest, strongest
from deshake.geometry.rotations import displacements, grid_steps, homographies
from deshake.operators.bilinear import bilinear_taps, gathering_matrix, splat
from deshake.operators.strips import in_order
from deshake.operators.transforms import power_of
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.tile_plan import Part
    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel
    from deshake.signal.pyramid import Pyramid

__all__ = [
    "SpectralMatch",
    "close_path",
    "descended",
    "match_of_path",
    "mean_match",
    "traced",
]

Image = NDArray[np.float32]
Spectrum = NDArray[np.complex64]
Points = NDArray[np.float64]

_S: Final = SETTINGS.spectral_match


class SpectralMatch:
    """Tiles of one scale of a photo, and the fluctuations of their spectra.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    level : int
        The scale.
    part : {"fitted", "apart", "all"}
        The tiles to use. If none of them is informative, tiles that cover the frame are used.
    wanted : SpectrumTiles
        Size and number of the tiles.

    """

    def __init__(
        self, pyramid: Pyramid, level: int, part: Part, wanted: SpectrumTiles = _S.tiles
    ) -> None:
        scale = pyramid.at(level)
        self.camera = scale.camera
        size = min(wanted.size, *(n - n % 2 for n in scale.camera.shape))
        corners = informative_corners(pyramid, level, size, wanted.count, width=_S.edges, part=part)
        corners = corners or covering(scale.camera.shape, size)[: wanted.count]
        self.size = size
        self.centres = np.array(corners)[:, ::-1] + (size - 1) / 2
        taper = np.hanning(size + 2)[1:-1].astype(np.float32)
        window = np.outer(taper, taper)
        tiles = np.stack([scale.piece(np.s_[y : y + size, x : x + size]) for y, x in corners])
        tiles = tiles - (tiles * window).sum((1, 2), keepdims=True) / window.sum()
        band = _S.slowest / size, _S.fastest
        self.fluctuations = Fluctuations(size, band, _S.fluctuation)
        power = box_filtered(power_of(scipy.fft.rfft2(tiles * window, workers=1)), _S.smoothing)
        offset = np.float32(_S.least_power) * power.max() + np.finfo(np.float32).tiny
        observed = self.fluctuations.of(np.log(power + offset))
        counts = self.fluctuations.counts
        spread = np.sqrt((observed**2 * counts).sum(1, keepdims=True) / counts.sum())
        bound = np.float32(_S.clip) * spread
        observed = self.fluctuations.off_lines(np.clip(observed, -bound, bound))
        length = np.sqrt(self.fluctuations.product(observed, observed))
        self.observed: Image = observed / np.float32(length or 1.0)

    def value(self, kernel: RotationKernel) -> float:
        """Return the correlation of the fluctuations, -1..1, for a kernel of the photo.

        The focal length of its camera may differ from that of the photo.
        """
        camera = kernel.camera.scaled(*self.camera.shape)
        moved = displacements(homographies(camera, kernel.theta), self.centres)
        moved -= np.einsum("k,pki->pi", kernel.weights, moved)[:, None]
        return self._expected(splat(moved, kernel.weights, (self.size, self.size))).match

    def fitted(self, kernel: RotationKernel) -> RotationKernel:
        """Draw a smooth path through a kernel, and move it to where it matches best.

        Parameters
        ----------
        kernel : RotationKernel
            A kernel that is nearly right, for the camera of the photo.

        Returns
        -------
        RotationKernel
            The path, on the grid of the kernel's camera. The kernel itself, if it is a point.

        """
        paths = SmoothPath.through(kernel, self.camera, _S.evenness)
        if not paths:
            return kernel
        begun = [descended([self], path, _S.first_iterations) for path in paths]
        best = max(begun, key=lambda one: one[0])[1]
        return descended([self], best, _S.iterations)[1].kernel(kernel.camera)

    def weighed(self, kernel: RotationKernel) -> RotationKernel:
        """Fit the weights of a kernel's rotations, without a smooth path.

        A smooth path has few control points, and some kernels need more. The rotations are first
        resampled to the grid of the scale, and faint ones are discarded.

        Parameters
        ----------
        kernel : RotationKernel
            A kernel that is nearly right, for the camera of the photo.

        Returns
        -------
        RotationKernel
            The kernel with fitted weights, for its own camera.

        """
        own = kernel.for_camera(self.camera).resampled(grid_steps(self.camera))
        own = strongest(heaviest(own, _S.faint), _S.most).centred()
        moved = displacements(homographies(self.camera, own.theta), self.centres)
        matrix = gathering_matrix(moved, (self.size, self.size))
        blocks = len(self.centres), self.size, self.size

        def objective(roots: Points) -> tuple[float, Points]:
            total = roots @ roots
            weights = roots**2 / total
            filters = (matrix.T @ weights.astype(np.float32)).reshape(blocks)
            match, change = self._correlation(filters)
            gradient = matrix @ change.ravel()
            return -match, -2 / total * roots * (gradient - weights @ gradient)

        _, roots = descent(objective, np.sqrt(own.weights), _S.weight_iterations)
        weights = roots**2 / (roots @ roots)
        return heaviest(replace(own, weights=weights), _S.light).centred().for_camera(kernel.camera)

    def of_path(self, path: SmoothPath) -> float:
        """Return the correlation for a path on the grid of the scale."""
        return self._expected(self._filters(_basis(path) @ path.controls)[0]).match

    def tracks(self, path: SmoothPath, count: int) -> Points:
        """Return how a path moves the centres of the tiles (P, T, 2) about their means, in px."""
        rotations = path.basis(count) @ path.controls
        moved: Points = np.einsum("pij,tj->pti", self.slopes, rotations)
        moved -= moved.mean(1, keepdims=True)
        return moved

    @cached_property
    def slopes(self) -> Points:
        """How a tile's centre moves (P, 2, 3), in pixels per grid step about each axis."""
        steps = grid_steps(self.camera)
        turned = displacements(homographies(self.camera, np.diag(steps)), self.centres)
        return np.swapaxes(turned, 1, 2)

    def of_rotations(self, rotations: Points) -> tuple[float, Points]:
        """Return the correlation of a path (T, 3) in grid steps, and its gradient (T, 3)."""
        filters, moved = self._filters(rotations)
        match, change = self._correlation(filters)
        across, down = _gradient_at(change, moved)
        gradient = np.einsum("pt,pj->tj", across, self.slopes[:, 0])
        gradient += np.einsum("pt,pj->tj", down, self.slopes[:, 1])
        gradient -= gradient.mean(0)
        return match, gradient / len(rotations)

    def _filters(self, rotations: Points) -> tuple[Image, Points]:
        """Return the filters (P, N, N) of a path (T, 3) in grid steps, and its tracks (P, T, 2)."""
        count = len(rotations)
        moved = np.einsum("pij,tj->pti", self.slopes, rotations - rotations.mean(0))
        return splat(moved, np.full(count, 1 / count), (self.size, self.size)), moved

    def _correlation(self, filters: Image) -> tuple[float, Image]:
        """Return the correlation for filters (P, N, N), and its gradient for each pixel."""
        spectra, power, fluctuations, length, match = self._expected(filters)
        fluctuations *= np.float32(-match / length)
        fluctuations += self.observed
        fluctuations /= np.float32(length)
        change = self.fluctuations.adjoint(fluctuations)
        change /= power
        spectra *= box_filtered(change, _S.smoothing)
        shape = self.size, self.size
        gradient = scipy.fft.irfft2(spectra, shape, overwrite_x=True, workers=1)
        return match, 2 * self.size**2 * gradient

    def _expected(self, filters: Image) -> _Expected:
        """Return what filters (P, N, N) lead to expect of the spectra."""
        spectra = scipy.fft.rfft2(filters, workers=1)
        power = box_filtered(power_of(spectra), _S.smoothing) + np.float32(_S.floor)
        fluctuations = self.fluctuations.of(np.log(power))
        length = max(self.fluctuations.product(fluctuations, fluctuations) ** 0.5, 1e-6)
        match = self.fluctuations.product(self.observed, fluctuations) / length
        return _Expected(spectra, power, fluctuations, length, match)


def mean_match(scales: Sequence[SpectralMatch], kernel: RotationKernel) -> float:
    """Return the mean correlation of a kernel at some scales."""
    return float(np.mean([one.value(kernel) for one in scales]))


def descended(
    scales: Sequence[SpectralMatch], path: SmoothPath, iterations: int, run: Run = Run()
) -> tuple[float, SmoothPath]:
    """Move a path to where it matches the spectra of one or more scales better.

    Parameters
    ----------
    scales : sequence of SpectralMatch
        The scales; the path is on the grid of the last one.
    path : SmoothPath
        The path. An axis about which it does not turn stays so.
    iterations : int
        Iterations of the descent.
    run : Run, optional
        Threads to use.

    Returns
    -------
    match : float
        The mean correlation, less a price of bends.
    path : SmoothPath
        The end of the descent.

    """
    basis, pairs = _basis(path), _with_ratios(scales, path)
    flat = np.ptp(path.controls, axis=0) == 0
    stiffness = _S.bending * np.square(scales[-1].slopes).mean((0, 1))

    def objective(flattened: Points) -> tuple[float, Points]:
        controls = flattened.reshape(path.controls.shape)
        match, gradient = _along(pairs, basis, controls, run)
        change = -gradient
        bends = price_of_bends(controls, stiffness, change)
        change[:, flat] = 0
        return bends - match, change.ravel()

    value, end = descent(objective, path.controls, iterations)
    return -value, path._replace(controls=end)


def match_of_path(
    scales: Sequence[SpectralMatch], path: SmoothPath, run: Run = Run()
) -> tuple[float, Points]:
    """Return the mean correlation of a path at some scales, and its gradient (n, 3).

    Parameters
    ----------
    scales : sequence of SpectralMatch
        The scales.
    path : SmoothPath
        The path, with n control points.
    run : Run, optional
        Threads to use.

    """
    return _along(_with_ratios(scales, path), _basis(path), path.controls, run)


def traced(
    scales: Sequence[SpectralMatch], kernel: RotationKernel, run: Run = Run()
) -> list[RotationKernel]:
    """Draw a smooth path of many control points closely along a kernel, and move it.

    Parameters
    ----------
    scales : sequence of SpectralMatch
        The scale of the kernel, the last one, and finer ones.
    kernel : RotationKernel
        A kernel that is nearly right, for the camera of the photo.
    run : Run, optional
        Threads to use.

    Returns
    -------
    list of RotationKernel
        The path after a few iterations and after all of them; none if the kernel is a point.

    """
    path = close_path(kernel, scales[-1].camera)
    if path is None:
        return []
    early = descended(scales, path.settled(kernel), _S.first_iterations, run)[1]
    late = descended(scales, early, _S.iterations, run)[1]
    return [early.kernel(kernel.camera), late.kernel(kernel.camera)]


def close_path(kernel: RotationKernel, scale: Camera) -> SmoothPath | None:
    """Draw a smooth path of many control points through a kernel; None if the kernel is a point."""
    paths = SmoothPath.through(kernel, scale, (_S.begun,))
    return paths[0].with_controls(round(_S.closer * len(paths[0].controls))) if paths else None


class _Expected(NamedTuple):
    """What filters lead to expect: spectra, power, fluctuations, their length, the correlation."""

    spectra: Spectrum
    power: Image
    fluctuations: Image
    length: float
    match: float


def _with_ratios(
    scales: Sequence[SpectralMatch], path: SmoothPath
) -> list[tuple[SpectralMatch, Points]]:
    """Return scales, each with the ratios of a path's grid steps to those of the scale."""
    return [(one, grid_steps(path.camera) / grid_steps(one.camera)) for one in scales]


def _along(
    scales: Sequence[tuple[SpectralMatch, Points]], basis: Points, controls: Points, run: Run
) -> tuple[float, Points]:
    """Return the mean correlation for control points (n, 3), and its gradient."""
    curve = basis @ controls
    match, change = 0.0, np.zeros_like(controls)
    for (_, ratio), (value, gradient) in in_order(
        lambda pair: pair[0].of_rotations(curve * pair[1]), scales, run
    ):
        match += value / len(scales)
        change += basis.T @ gradient * (ratio / len(scales))
    return match, change


def _basis(path: SmoothPath) -> Points:
    """Return the weights of a path's control points, at times a fraction of a pixel apart."""
    return path.basis(int(np.clip(_S.along * path.length, _S.fewest, _S.most)))


def _gradient_at(blocks: Image, places: Points) -> tuple[Points, Points]:
    """Return the slopes of periodic blocks (P, N, N), interpolated, at places (P, T, 2)."""
    place, _ = bilinear_taps(places, blocks.shape[1:])
    flat = blocks.reshape(len(blocks), -1)
    taps = np.take_along_axis(flat, place.reshape(len(blocks), -1), 1).reshape(place.shape)
    upper_left, upper_right, lower_left, lower_right = np.moveaxis(taps, -1, 0)
    a, b = np.moveaxis(places - np.floor(places), -1, 0)
    across = (1 - b) * (upper_right - upper_left) + b * (lower_right - lower_left)
    down = (1 - a) * (lower_left - upper_left) + a * (lower_right - upper_right)
    return across, down
