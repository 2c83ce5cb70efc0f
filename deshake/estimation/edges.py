"""Fast blind estimation: sharp edges and least squares in turn, from coarse to fine.

At each scale the latent picture (`latent_edges`) and the kernel (`kernel_step`) are estimated in
turn, as by Cho & Lee (2009) and Xu & Jia (2010), on the rotational model. The kernel grows at the
coarsest scale and by one grid step at each finer one: no size need be known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.trimming import main_piece, strongest
from deshake.blind.variational.coarse_to_fine import turned_gradients
from deshake.estimation.edge_scale import EdgeScale
from deshake.estimation.edge_settings import FAINT, SETTINGS, EdgeSetting
from deshake.estimation.latent_edges import contrast_scaled, least_price
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.geometry.camera import Camera

__all__ = ["FAINT", "SETTINGS", "EdgeEstimate", "EdgeSetting", "estimate_edges"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_RATIO = 2**0.5  # of one scale to the next
_COARSEST_SIDE = 48  # px, the shorter side of the coarsest scale
_ITERATIONS = 5  # at each scale
_CARRIED_UNIFORM = 0.02  # weights that a finer scale begins with, of the largest
_START_HALF = (2, 2, 1)  # grid steps
_GROWTH_LIMIT = 6  # the kernel grows up to one over this of the shorter side
_MOST_GROWN = 500  # rotations: an estimate's cost grows with their square
_BELIEVED = 0.5  # share of a pixel that must be usable when the photo is reduced
_FINISHING = 4  # iterations at the finest scale, in the end
_FINISHING_PRICE = 1e-3
_FINISHING_CUT = 0.015
_ROOM_STEPS = 2  # grid steps that the box is wider than the bound of the blur
_WIDEST = 60.0  # px of a scale: kernels that would be wider end at a coarser one


@dataclass(frozen=True, eq=False)
class EdgeEstimate:
    """A blur kernel, and the latent picture whose edges it was estimated from.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel, its centroid at the origin.
    latent : (2, h, w) array of float32
        Gradients of the last latent picture, at the size of the last scale: differences to the
        right and to the lower neighbour, in linear light, in the kernel's frame.

    """

    kernel: RotationKernel
    latent: Image


def estimate_edges(
    grey: Image,
    camera: Camera,
    *,
    usable: Mask | None = None,
    blur_px: float | None = None,
    axes: tuple[bool, bool, bool] = ALL_AXES,
    setting: EdgeSetting = SETTINGS[0],
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> EdgeEstimate:
    """Estimate the blur kernel of one photo from its sharp edges.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, at the largest size to work at: 640 px or so. Kernels that would
        be wider than 60 px there are estimated at a smaller one.
    camera : Camera
        Its camera; of the uniform model with `Camera.uniform` and no roll.
    usable : (h, w) array of bool, optional
        Pixels to be believed; by default all. Others are filled in with what the estimate says.
    blur_px : float, optional
        Bound of the blur in pixels of `grey`. By default the kernel grows as the edges ask.
    axes : three bools
        The axes that the camera may turn about.
    setting : EdgeSetting
        Which edges count.
    threads : int, optional
        Threads to use; by default all processors. The result does not depend on it.
    progress : callable, optional
        Called with the share done, 0..1, and a text.

    Returns
    -------
    EdgeEstimate
        The kernel for `camera`, and the latent picture.

    Raises
    ------
    EstimationError
        If the photo is flat.

    """
    run = _Run(
        grey,
        camera,
        usable=usable,
        blur_px=blur_px,
        axes=axes,
        setting=setting,
        threads=threads,
    )
    return run.estimate(progress)


class _Run:
    """One estimate under way."""

    def __init__(
        self,
        grey: Image,
        camera: Camera,
        *,
        usable: Mask | None,
        blur_px: float | None,
        axes: tuple[bool, bool, bool],
        setting: EdgeSetting,
        threads: int | None,
    ) -> None:
        self.light = grey
        gamma = np.float32(1 / setting.gamma)
        self.grey, self.contrast = contrast_scaled(np.maximum(grey, 0) ** gamma)
        self.camera = camera
        self.usable = usable
        self.blur_px = blur_px
        self.axes = (axes[0], axes[1], axes[2] and not camera.is_uniform)
        self.setting = setting
        self.threads = threads
        shorter = min(grey.shape)
        self.scales = max(int(np.log(shorter / _COARSEST_SIDE) / np.log(_RATIO)), 0) + 1
        self.latent: Image | None = None

    def estimate(self, progress: Callable[[float, str], None] | None) -> EdgeEstimate:
        """Work through the scales."""
        shares = np.cumsum([0.0] + [2.0**-level for level in range(self.scales - 1, -1, -1)])
        active: RotationKernel | None = None
        for done, level in enumerate(range(self.scales - 1, -1, -1)):
            if progress is not None:
                progress(shares[done] / shares[-1], f"scale {done + 1} of {self.scales}")
            size = [round(n / _RATIO**level) for n in self.camera.shape]
            camera = self.camera.scaled(*size)
            active = self._start(camera) if active is None else self._finer(active, camera)
            active = self._estimate(active, level)
            if self._is_wide(active):
                active = main_piece(active)  # a hand's path hangs together
                if self._is_wide(active):
                    break  # finer, it would break up, at many times the cost
        assert active is not None  # noqa: S101 - there is at least one scale
        kernel = self._finished(active)
        latent = turned_gradients(self._latent_in_light(kernel), kernel.camera, kernel.centroid)
        if progress is not None:
            progress(1.0, "kernel estimated")
        return EdgeEstimate(kernel.centred().for_camera(self.camera), latent)

    def _is_wide(self, kernel: RotationKernel) -> bool:
        """Tell whether a kernel would be wider at the next scale than is known well."""
        return kernel.above(self.setting.cut).extent_px() * _RATIO > _WIDEST

    def _latent_in_light(self, kernel: RotationKernel) -> Image:
        """Gradients of the last latent picture in linear light."""
        assert self.latent is not None  # noqa: S101
        if self.setting.gamma == 1:
            return self.latent / np.float32(self.contrast)
        light, contrast = contrast_scaled(self.light)
        scale = EdgeScale(kernel, *self._resized(light, kernel.camera), self.threads)
        scale.edges(kernel, self.setting.last, shock=False)
        return scale.latent_gradients() / np.float32(contrast)

    def _start(self, camera: Camera) -> RotationKernel:
        """A little cube: half of the weight at rest, half beside it, to break the symmetry."""
        halves = [n if axis else 0 for n, axis in zip(_START_HALF, self.axes, strict=True)]
        grids = np.meshgrid(*(np.arange(-n, n + 1) for n in halves), indexing="ij")
        indices = np.stack(grids, -1).reshape(-1, 3)
        beside = np.array([0, 1, 0]) if self.axes[1] else np.array(self.axes, int)
        rest = np.all(indices == 0, 1) | np.all(indices == beside, 1)
        return RotationKernel.from_indices(indices, rest, grid_steps(camera), camera)

    def _finer(self, kernel: RotationKernel, camera: Camera) -> RotationKernel:
        """Carry the kernel to the next scale: resample, cut, recentre, give it room."""
        finer = (
            kernel.above(self.setting.cut)
            .resampled(grid_steps(camera), self.axes)
            .for_camera(camera)
        )
        carried = self.setting.carried
        finer = finer.above(min(carried, _CARRIED_UNIFORM) if camera.is_uniform else carried)
        finer = strongest(finer, self.setting.most)
        finer = finer.shifted(-np.rint(finer.centroid / finer.steps).astype(np.int64))
        return self._inside(finer.dilated(self.axes))

    def _inside(self, kernel: RotationKernel) -> RotationKernel:
        """Drop rotations beyond the bound of the blur."""
        if self.blur_px is None:
            return kernel
        shrink = kernel.camera.width / self.camera.width
        half = int(np.ceil(self.blur_px * shrink / 2)) + _ROOM_STEPS
        keep = np.all(np.abs(kernel.indices) <= half, 1)
        if not kernel.weights[keep].sum() > 0:
            return kernel
        return RotationKernel.from_indices(
            kernel.indices[keep], kernel.weights[keep], kernel.steps, kernel.camera
        )

    def _estimate(self, kernel: RotationKernel, level: int) -> RotationKernel:
        """Estimate picture and kernel in turn at one scale."""
        camera = kernel.camera
        grey, usable = self._resized(self.grey, camera)
        total = self.scales * _ITERATIONS
        setting = self.setting
        scale = EdgeScale(kernel, grey, usable, self.threads)
        for i in range(_ITERATIONS):
            done = (self.scales - 1 - level) * _ITERATIONS + i
            lam = setting.first * (setting.last / setting.first) ** (done / max(total - 1, 1))
            edges = scale.edges(kernel, lam, shock=i < setting.shocks)
            kernel = scale.refined(kernel, edges, cut=setting.cut)
            if level == self.scales - 1 and i < _ITERATIONS - 1:
                grown = self._grown(kernel)
                if len(grown.weights) > len(kernel.weights):
                    kernel = grown
                    scale = EdgeScale(kernel, grey, usable, self.threads)
        self.latent = scale.latent_gradients()
        return kernel

    def _finished(self, kernel: RotationKernel) -> RotationKernel:
        """Estimate in turn a few times more, from edges as they are and at a low price.

        What finds a kernel, few edges and sharpened ones, is not what is truest to it. Only uniform
        blur is known well enough for that, and only where the noise is weaker than such edges.
        """
        kernel = kernel.above(self.setting.cut)
        noisy = least_price(self.grey) > _FINISHING_PRICE
        if noisy or not kernel.camera.is_uniform:
            return kernel
        cut = min(self.setting.cut, _FINISHING_CUT)
        kernel = self._inside(kernel.dilated(self.axes))
        scale = EdgeScale(kernel, *self._resized(self.grey, kernel.camera), self.threads)
        for _ in range(_FINISHING):
            edges = scale.strong_edges(kernel, _FINISHING_PRICE)
            kernel = scale.refined(kernel, edges, cut=cut)
        self.latent = scale.latent_gradients()
        return kernel.above(cut)

    def _grown(self, kernel: RotationKernel) -> RotationKernel:
        """Give the kernel room around its non-zero weights, where it may still grow."""
        around = kernel.above(self.setting.cut).dilated(self.axes)
        indices = np.concatenate([kernel.indices, around.indices])
        weights = np.concatenate([kernel.weights, np.zeros(len(around.weights))])
        grown = self._inside(
            RotationKernel.from_indices(indices, weights, kernel.steps, kernel.camera)
        )
        limit = max(3, min(kernel.camera.shape) // _GROWTH_LIMIT)
        fits = np.abs(grown.indices).max() <= limit and len(grown.weights) <= _MOST_GROWN
        return grown if fits else kernel

    def _resized(self, picture: Image, camera: Camera) -> tuple[Image, Mask | None]:
        """Reduce a picture, and the mask with it, to the size of a scale."""
        if camera.shape == self.camera.shape:
            return picture, self.usable
        size = camera.width, camera.height
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        if self.usable is None:
            return small, None
        part = cv2.resize(self.usable.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        return small, np.asarray(part > _BELIEVED)
