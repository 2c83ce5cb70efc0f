"""One candidate kernel, from a first scale to finer ones: latent edges and kernel in turn.

At each scale the latent picture (`sharp_edges`) and the kernel (`kernel_step`) are estimated in
turn, as by Cho & Lee (2009) and Xu & Jia (2010), on the rotational model. A shake is found from a
scale where it is a few pixels wide: coarser, it is no more than a point, and finer, it is too wide
to be found at once. So the first scale matters more than anything else, and `race` tries several.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deshake.blind.kernel_step import RotationGrid, fitted_weights
from deshake.blind.sharp_edges import Edges, latent_edges
from deshake.blind.tile_plan import Budget, Part, planned_tiles
from deshake.blind.tiles import reach
from deshake.blind.trimming import heaviest, main_piece, strongest
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.blind.tiles import Tiles
    from deshake.geometry.camera import Camera
    from deshake.signal.pyramid import Pyramid

__all__ = ["FINE", "Candidate", "Refinement", "Setting", "edge_floor", "refined"]

Axes = tuple[bool, bool, bool]

_START_HALF = (2, 2, 1)  # grid steps
_GROWTH_LIMIT = 6  # the kernel grows up to one over this of the shorter side
_LIGHT = 1e-4  # of the weight: what is below is zero
_FAINT = 0.05  # of the weight, that does not make a kernel wider
_MAIN = 0.8  # share of a wide kernel that its main piece holds, if the rest is to be dropped


@dataclass(frozen=True)
class Setting:
    """What an estimate counts as an edge, and what of a kernel it keeps.

    Tuned on the benchmark's set to tune on: photos of 0.1 to 16 MP, shakes of 3 to 120 px.

    Parameters
    ----------
    first, last : float
        Price of an edge pixel at first, and after `falling` iterations; geometric in between. Too
        low a price and the kernel collapses to a point, too high and it widens.
    falling : int
        Iterations.
    iterations, shocks : int
        Of each scale, and those of them, the first ones, that see shock-filtered edges.
    cut, carried : float
        The smallest weights that together hold less than this share are noise: after a fit, and
        when a finer scale begins.
    most, most_grown : int
        Rotations that a finer scale begins with, before it is given room, and rotations that a
        kernel may grow to.
    small : float
        Pixels up to which a kernel is free to grow at every scale.
    wide : float
        Pixels that a kernel may be wide: wider, it would break up.
    noise : float
        Least price of an edge, in variances of the noise.

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


FINE = Setting()


class Refinement(NamedTuple):
    """How a kernel that is about right is refined at one scale.

    Parameters
    ----------
    price : float
        Of an edge pixel.
    iterations : int
        Of latent picture and kernel.
    carried, cut : float
        The smallest weights that together hold less than this share are dropped: at the beginning,
        and after a fit.
    most : int
        Rotations to begin with, before they are given room.
    room : bool
        Whether they are given room.
    budget : Budget
        Pixels to look at.

    """

    price: float
    iterations: int = 8
    carried: float = 0.01
    cut: float = 0.03
    most: int = 300
    room: bool = True
    budget: Budget = Budget(0.25e6, 0.3e6)


class Candidate:
    """A kernel under way from coarse to fine.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    start : int
        Number of the first scale.
    setting : Setting
        What counts as an edge.
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
        """Work on the next finer scale; False if there is none that the kernel fits."""
        if self.level == 0 or not self._fits_next():
            return False
        self.level -= 1
        scale = self.pyramid.at(self.level)
        first = self._kernel is None
        self._kernel = _start(scale.camera, self.axes) if first else self._carried(scale.camera)
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
        self._kernel = piece  # a hand's path hangs together
        return True

    def _price(self) -> float:
        s = self.setting
        done = min(self._iterations / max(s.falling - 1, 1), 1.0)
        return float(s.first * (s.last / s.first) ** done)

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
        """Carry the kernel to the next scale: resample, cut, recentre, give it room."""
        kept = heaviest(self._own, _LIGHT).for_camera(camera)
        finer = heaviest(kept.resampled(grid_steps(camera), self.axes), self.setting.carried)
        finer = strongest(finer, self.setting.most)
        finer = finer.shifted(-np.rint(finer.centroid / finer.steps).astype(np.int64))
        return self._inside(finer.dilated(self.axes))

    def _grow(self) -> None:
        """Give the kernel room around its non-zero weights, where it may still grow."""
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
        """Drop rotations beyond the bound of the blur."""
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
    """Least price of an edge that is no noise, at a scale."""
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
    """Estimate latent picture and kernel in turn a few times, from a kernel that is about right.

    More edges than a kernel is found by, and no sharpened ones, come nearer to the truth; from a
    wrong kernel they lead on to a point. So whoever refines lets the judge compare.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    kernel : RotationKernel
        For the camera of the photo.
    level : int
        The scale to work at.
    how : Refinement
        Price and budget.
    axes : three bools
        The axes that the camera may turn about.
    part : {"fitted", "apart", "all"}
        The tiles to look at.

    Returns
    -------
    RotationKernel
        For the camera of the photo, centred.

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
    """One number for each rotation of a grid."""
    keys: NDArray[np.int64] = kernel.indices @ np.array([1, 1 << 20, 1 << 40])
    return keys


def _start(camera: Camera, axes: Axes) -> RotationKernel:
    """A little cube: half of the weight at rest, half beside it, to break the symmetry."""
    halves = [n if axis else 0 for n, axis in zip(_START_HALF, axes, strict=True)]
    grids = np.meshgrid(*(np.arange(-n, n + 1) for n in halves), indexing="ij")
    indices = np.stack(grids, -1).reshape(-1, 3)
    beside = np.array([0, 1, 0]) if axes[1] else np.array(axes, int)
    rest = np.all(indices == 0, 1) | np.all(indices == beside, 1)
    return RotationKernel.from_indices(indices, rest, grid_steps(camera), camera)
