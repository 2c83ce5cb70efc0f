"""One candidate kernel, estimated from a first scale to finer ones.

At each scale the estimate alternates between the latent picture (`sharp_edges`) and the kernel
(`kernel_step`), as Cho & Lee (2009) and Xu & Jia (2010) do, but on the rotational model. The first
scale matters most. The estimate succeeds if the shake is a few pixels wide there. At a coarser
scale the shake is only a point; at a finer scale it is too wide for the first estimate. So `race`
tries several first scales.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.camera_path import thinned
from deshake.blind.kernel_step import RotationGrid, fitted_weights
from deshake.blind.settings import SETTINGS
from deshake.blind.sharp_edges import Edges, latent_edges
from deshake.blind.tile_plan import Part, planned_tiles
from deshake.blind.trimming import heaviest, main_piece, strongest
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps, reach
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.blind.settings import Refinement, Way
    from deshake.blind.tiles import Tiles
    from deshake.geometry.camera import Camera
    from deshake.signal.pyramid import Pyramid

__all__ = ["Candidate", "edge_floor", "refined"]

Axes = tuple[bool, bool, bool]

_S: Final = SETTINGS.candidate


class Candidate:
    """A kernel that is estimated from coarse to fine.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    start : int
        Index of the first scale.
    way : Way
        Prices and shares of the estimate.
    axes : three bools
        The axes that the camera may turn about.
    bound : float, optional
        Largest extent of the kernel in pixels of the photo.

    """

    def __init__(
        self,
        pyramid: Pyramid,
        start: int,
        way: Way = _S.fine,
        *,
        axes: Axes = ALL_AXES,
        bound: float | None = None,
    ) -> None:
        self.pyramid = pyramid
        self.start = start
        self.way = way
        self.axes = (axes[0], axes[1], axes[2] and not pyramid.camera.is_uniform)
        self.bound = bound
        self.level = start + 1
        self._kernel: RotationKernel | None = None
        self._iterations = 0
        self._tiles: Tiles
        self._grid: RotationGrid | None = None

    @property
    def kernel(self) -> RotationKernel:
        """The kernel for the whole photo, centred."""
        return heaviest(self._own, _S.light).centred().for_camera(self.pyramid.camera)

    @property
    def width(self) -> float:
        """Width of the kernel in pixels of its scale."""
        return heaviest(self._own, _S.faint).extent_px()

    @property
    def _own(self) -> RotationKernel:
        if self._kernel is None:
            raise ValueError("no scale has been worked on")
        return self._kernel

    def advance(self) -> bool:
        """Estimate at the next finer scale; return False if the kernel fits no finer scale."""
        if self.level == 0 or not self._fits_next():
            return False
        self.level -= 1
        scale = self.pyramid.at(self.level)
        first = self._kernel is None
        self._kernel = (
            _first_kernel(scale.camera, self.axes) if first else self._carried(scale.camera)
        )
        floor = edge_floor(self.pyramid, self.level, self.way.noise)
        self._cut_tiles()
        for i in range(self.way.iterations):
            self._tiles.bind(self._own)
            self._fit(max(self._price(), floor), "shock" if i < self.way.shocks else "l0")
            self._iterations += 1
            last = i == self.way.iterations - 1
            if not last and (first or self.width < self.way.small):
                self._grow()
        return True

    def _fits_next(self) -> bool:
        if self._kernel is None or self.width * RATIO <= self.way.wide:
            return True
        piece = main_piece(self._kernel)
        kept = np.isin(_keys(self._kernel), _keys(piece))
        if self._kernel.weights[kept].sum() < _S.main:
            return False
        if heaviest(piece, _S.faint).extent_px() * RATIO > self.way.wide:
            return False
        self._kernel = piece  # the path of a hand is connected
        return True

    def _price(self) -> float:
        s = self.way
        done = min(self._iterations / max(s.falling - 1, 1), 1.0)
        price = float(s.first * (s.last / s.first) ** done)
        if not s.thin:
            return price
        here = self._iterations % s.iterations / max(s.iterations - 1, 1)
        return float(price * (s.last / price) ** here)

    def _cut_tiles(self) -> None:
        self._tiles = planned_tiles(self.pyramid, self.level, self._own)
        self._grid = None

    def _fit(self, price: float, edges: Edges) -> None:
        own = self._own
        if self._grid is None:
            self._grid = RotationGrid(self._tiles, own.indices, own.steps)
        fit = self._grid.equations(latent_edges(self._tiles, price, edges))
        weights = fitted_weights(fit, self._grid.indices, own.weights, cut=self.way.cut)
        self._kernel = replace(own, weights=weights)

    def _carried(self, camera: Camera) -> RotationKernel:
        """Transfer the kernel to the next scale: resample it, trim it, centre it, add room."""
        kept = heaviest(self._own, _S.light)
        kept = (thinned(kept) if self.way.thin else kept).for_camera(camera)
        finer = heaviest(kept.resampled(grid_steps(camera), self.axes), self.way.carried)
        finer = strongest(finer, self.way.most)
        finer = finer.shifted(-np.rint(finer.centroid / finer.steps).astype(np.int64))
        return self._inside(finer.dilated(self.axes))

    def _grow(self) -> None:
        """Add room around the non-zero weights, if the kernel may still grow."""
        own = self._own
        around = heaviest(own, _S.light).dilated(self.axes)
        indices = np.concatenate([own.indices, around.indices])
        weights = np.concatenate([own.weights, np.zeros(len(around.weights))])
        grown = self._inside(RotationKernel.from_indices(indices, weights, own.steps, own.camera))
        limit = max(_S.least_growth, min(own.camera.shape) // _S.growth_limit)
        fits = np.abs(grown.indices).max() <= limit and len(grown.weights) <= self.way.most_grown
        if not fits or len(grown.weights) == len(own.weights):
            return
        self._kernel = grown
        self._grid = None
        if reach(own.camera, grown.theta) > self._tiles.far:
            self._cut_tiles()

    def _inside(self, kernel: RotationKernel) -> RotationKernel:
        """Discard the rotations beyond the bound of the blur."""
        if self.bound is None:
            return kernel
        shrink = kernel.camera.width / self.pyramid.camera.width
        half = int(np.ceil(self.bound * shrink / 2)) + _S.spare
        keep = np.all(np.abs(kernel.indices) <= half, 1)
        if not kernel.weights[keep].sum() > 0:
            return kernel
        return RotationKernel.from_indices(
            kernel.indices[keep], kernel.weights[keep], kernel.steps, kernel.camera
        )


def edge_floor(pyramid: Pyramid, level: int, variances: float = _S.fine.noise) -> float:
    """Return the least price of an edge at a scale: a cheaper edge may be noise."""
    return float(variances * pyramid.noise(level) ** 2)


def refined(
    pyramid: Pyramid,
    kernel: RotationKernel,
    level: int,
    how: Refinement,
    *,
    axes: Axes = ALL_AXES,
    part: Part = "fitted",
) -> RotationKernel:
    """Refine an approximate kernel: estimate latent picture and kernel in turn a few times.

    A refinement uses more edges than a candidate does, and no sharpened edges. This brings an
    approximate kernel nearer to the truth, but it shrinks a wrong kernel to a point. So the caller
    compares the refined kernel with the others by the judge.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    kernel : RotationKernel
        The approximate kernel, for the camera of the photo.
    level : int
        The scale of the refinement.
    how : Refinement
        Settings of the refinement.
    axes : three bools
        The axes that the camera may turn about.
    part : {"fitted", "apart", "all"}
        The tiles that the refinement uses.

    Returns
    -------
    RotationKernel
        The refined kernel, for the camera of the photo, centred.

    """
    camera = pyramid.camera_at(level)
    finer = heaviest(kernel.for_camera(camera).resampled(grid_steps(camera), axes), how.carried)
    finer = strongest(finer, how.most)
    if how.room:
        finer = finer.dilated(axes)
    price = max(how.price, edge_floor(pyramid, level))
    tiles = planned_tiles(pyramid, level, finer, part=part, budget=how.budget)
    grid = RotationGrid(tiles, finer.indices, finer.steps)
    for _ in range(how.iterations):
        tiles.bind(finer)
        fit = grid.equations(latent_edges(tiles, price, "l0"), pyramid.noise(level))
        weights = fitted_weights(fit, grid.indices, finer.weights, cut=how.cut)
        finer = replace(finer, weights=weights)
    return heaviest(finer, _S.light).centred().for_camera(pyramid.camera)


def _keys(kernel: RotationKernel) -> NDArray[np.int64]:
    """Return one number for each rotation of a grid."""
    keys: NDArray[np.int64] = kernel.indices @ np.array([1, 1 << 20, 1 << 40])
    return keys


def _first_kernel(camera: Camera, axes: Axes) -> RotationKernel:
    """Return a small cube: half of the weight at rest, half beside it, to break the symmetry."""
    halves = [n if axis else 0 for n, axis in zip(_S.start_half, axes, strict=True)]
    grids = np.meshgrid(*(np.arange(-n, n + 1) for n in halves), indexing="ij")
    indices = np.stack(grids, -1).reshape(-1, 3)
    beside = np.array([0, 1, 0]) if axes[1] else np.array(axes, int)
    rest = np.all(indices == 0, 1) | np.all(indices == beside, 1)
    return RotationKernel.from_indices(indices, rest, grid_steps(camera), camera)
