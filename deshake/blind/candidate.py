"""One candidate kernel, estimated from a first scale to finer ones.

At each scale the estimate alternates between the latent picture (`sharp_edges`) and the kernel
(`kernel_step`), as Cho & Lee (2009) and Xu & Jia (2010) do, but on the rotational model. The first
scale matters most. The estimate succeeds if the shake is a few pixels wide there. At a coarser
scale the shake is only a point; at a finer scale it is too wide for the first estimate. So `race`
tries several first scales.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deshake.blind.camera_path import thinned
from deshake.blind.kernel_step import RotationGrid, fitted_weights
from deshake.blind.sharp_edges import Edges, latent_edges
from deshake.blind.tile_plan import Budget, Part, planned_tiles
from deshake.blind.trimming import heaviest, main_piece, strongest
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps, reach
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.blind.tiles import Tiles
    from deshake.geometry.camera import Camera
    from deshake.signal.pyramid import Pyramid

__all__ = [
    "FINE",
    "THIN",
    "Candidate",
    "Refinement",
    "Setting",
    "edge_floor",
    "first_kernel",
    "refined",
]

Axes = tuple[bool, bool, bool]

_START_HALF = (2, 2, 1)  # grid steps about X, Y and Z: half size of the first cube
_GROWTH_LIMIT = 6  # ratio of the frame's shorter side to the largest index of a grown kernel
_LIGHT = 1e-4  # share of the kernel's weight; rotations that hold less are discarded
_FAINT = 0.05  # share of the kernel's weight that its width does not count
_MAIN = 0.8  # share of a wide kernel's weight; a main piece with less does not replace it


@dataclass(frozen=True)
class Setting:
    """Settings of one candidate: the price of edges, and the part of a kernel to keep.

    The values are tuned on the benchmark's tuning set: photos of 0.1 to 16 MP, shakes of 3 to
    120 px.

    Parameters
    ----------
    first, last : float
        Price of an edge pixel in the first iteration, and after `falling` iterations. In between
        the price falls geometrically. If it is too low, the kernel collapses to a point; if it is
        too high, the kernel widens.
    falling : int
        Number of iterations in which the price falls.
    iterations, shocks : int
        Number of iterations at each scale. The first `shocks` of them use shock-filtered edges.
    cut, carried : float
        Shares of the kernel's weight. The smallest weights that together hold less than this share
        are noise: `cut` after a fit, `carried` at the beginning of a finer scale.
    most, most_grown : int
        Largest number of rotations: `most` at the beginning of a finer scale, before the kernel
        gets room; `most_grown` after growth.
    small : float
        Width in pixels of the scale. A narrower kernel may grow at every scale.
    wide : float
        Width in pixels of the scale. A wider kernel would break into pieces.
    noise : float
        Least price of an edge, in variances of the noise.
    thin : bool
        Whether a kernel is reduced to a thin path before a finer scale, and the price falls to
        `last` within each scale. Otherwise a kernel stays as wide as its estimate. Wide shakes
        often succeed in only one of the two ways.

    """

    first: float = 8e-2
    last: float = 2e-3
    falling: int = 45
    iterations: int = 5
    shocks: int = 3
    cut: float = 0.03
    carried: float = 0.03
    most: int = 150
    most_grown: int = 500
    small: float = 8.0
    wide: float = 41.0
    noise: float = 10.0
    thin: bool = False


FINE = Setting()
THIN = Setting(thin=True)


class Refinement(NamedTuple):
    """Settings for the refinement of an approximate kernel at one scale.

    Parameters
    ----------
    price : float
        Price of an edge pixel.
    iterations : int
        Number of iterations. Each estimates the latent picture and then the kernel.
    carried, cut : float
        Shares of the kernel's weight. The smallest weights that together hold less than this share
        are discarded: `carried` at the beginning, `cut` after a fit.
    most : int
        Largest number of rotations at the beginning, before the kernel gets room.
    room : bool
        Whether the kernel gets room around its rotations.
    budget : Budget
        Number of pixels that the estimate uses.

    """

    price: float
    iterations: int = 8
    carried: float = 0.01
    cut: float = 0.03
    most: int = 160
    room: bool = True
    budget: Budget = Budget(0.25e6, 0.3e6)


class Candidate:
    """A kernel that is estimated from coarse to fine.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    start : int
        Index of the first scale.
    setting : Setting
        Settings of the estimate.
    axes : three bools
        The axes that the camera may turn about.
    bound : float, optional
        Largest extent of the kernel in pixels of the photo.

    """

    def __init__(
        self,
        pyramid: Pyramid,
        start: int,
        setting: Setting = FINE,
        *,
        axes: Axes = ALL_AXES,
        bound: float | None = None,
    ) -> None:
        self.pyramid = pyramid
        self.start = start
        self.setting = setting
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
        return heaviest(self._own, _LIGHT).centred().for_camera(self.pyramid.camera)

    @property
    def width(self) -> float:
        """Width of the kernel in pixels of its scale."""
        return heaviest(self._own, _FAINT).extent_px()

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
            first_kernel(scale.camera, self.axes) if first else self._carried(scale.camera)
        )
        floor = edge_floor(self.pyramid, self.level, self.setting.noise)
        self._cut_tiles()
        for i in range(self.setting.iterations):
            self._tiles.bind(self._own)
            self._fit(max(self._price(), floor), "shock" if i < self.setting.shocks else "l0")
            self._iterations += 1
            last = i == self.setting.iterations - 1
            if not last and (first or self.width < self.setting.small):
                self._grow()
        return True

    def _fits_next(self) -> bool:
        if self._kernel is None or self.width * RATIO <= self.setting.wide:
            return True
        piece = main_piece(self._kernel)
        kept = np.isin(_keys(self._kernel), _keys(piece))
        if self._kernel.weights[kept].sum() < _MAIN:
            return False
        if heaviest(piece, _FAINT).extent_px() * RATIO > self.setting.wide:
            return False
        self._kernel = piece  # the path of a hand is connected
        return True

    def _price(self) -> float:
        s = self.setting
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
        weights = fitted_weights(fit, self._grid.indices, own.weights, cut=self.setting.cut)
        self._kernel = replace(own, weights=weights)

    def _carried(self, camera: Camera) -> RotationKernel:
        """Transfer the kernel to the next scale: resample it, trim it, centre it, add room."""
        kept = heaviest(self._own, _LIGHT)
        kept = (thinned(kept) if self.setting.thin else kept).for_camera(camera)
        finer = heaviest(kept.resampled(grid_steps(camera), self.axes), self.setting.carried)
        finer = strongest(finer, self.setting.most)
        finer = finer.shifted(-np.rint(finer.centroid / finer.steps).astype(np.int64))
        return self._inside(finer.dilated(self.axes))

    def _grow(self) -> None:
        """Add room around the non-zero weights, if the kernel may still grow."""
        own = self._own
        around = heaviest(own, _LIGHT).dilated(self.axes)
        indices = np.concatenate([own.indices, around.indices])
        weights = np.concatenate([own.weights, np.zeros(len(around.weights))])
        grown = self._inside(RotationKernel.from_indices(indices, weights, own.steps, own.camera))
        limit = max(3, min(own.camera.shape) // _GROWTH_LIMIT)
        fits = (
            np.abs(grown.indices).max() <= limit and len(grown.weights) <= self.setting.most_grown
        )
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
        half = int(np.ceil(self.bound * shrink / 2)) + 2
        keep = np.all(np.abs(kernel.indices) <= half, 1)
        if not kernel.weights[keep].sum() > 0:
            return kernel
        return RotationKernel.from_indices(
            kernel.indices[keep], kernel.weights[keep], kernel.steps, kernel.camera
        )


def edge_floor(pyramid: Pyramid, level: int, variances: float = FINE.noise) -> float:
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
    camera = pyramid.at(level).camera
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
    return heaviest(finer, _LIGHT).centred().for_camera(pyramid.camera)


def _keys(kernel: RotationKernel) -> NDArray[np.int64]:
    """Return one number for each rotation of a grid."""
    keys: NDArray[np.int64] = kernel.indices @ np.array([1, 1 << 20, 1 << 40])
    return keys


def first_kernel(camera: Camera, axes: Axes) -> RotationKernel:
    """Return a small cube: half of the weight at rest, half beside it, to break the symmetry."""
    halves = [n if axis else 0 for n, axis in zip(_START_HALF, axes, strict=True)]
    grids = np.meshgrid(*(np.arange(-n, n + 1) for n in halves), indexing="ij")
    indices = np.stack(grids, -1).reshape(-1, 3)
    beside = np.array([0, 1, 0]) if axes[1] else np.array(axes, int)
    rest = np.all(indices == 0, 1) | np.all(indices == beside, 1)
    return RotationKernel.from_indices(indices, rest, grid_steps(camera), camera)
