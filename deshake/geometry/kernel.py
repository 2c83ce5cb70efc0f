"""The blur kernel ``w`` over camera rotations: sparse weights on a 3-D grid (Secs. 2.3 and 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from deshake.geometry.rotations import (
    compose,
    displacements,
    grid_steps,
    homographies,
    reach,
    rotation_matrices,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from deshake.geometry.camera import Camera

__all__ = ["ALL_AXES", "RotationKernel"]

ALL_AXES = (True, True, True)
_SUM_TOLERANCE = 1e-6  # weights whose sum differs from 1 by more are an error
_PATH_PIECE = 0.25  # grid steps: longest piece between two samples of a camera path
_KEY_RANGE = 1 << 20  # grid indices are within +- half of it


@dataclass(frozen=True, eq=False)
class RotationKernel:
    """Weights over rotations: the blur kernel of ``g(x) = sum_k w_k f(H_k x)``, Eq. (7).

    Parameters
    ----------
    theta : (K, 3) array of float64
        Rotations as angle-axis vectors in radians.
    weights : (K,) array of float64
        Shares of the exposure, >= 0, summing to 1.
    steps : (3,) array of float64
        Spacing of the grid about X, Y, Z in radians, > 0.
    camera : Camera
        The camera of the photo that the kernel belongs to.

    Raises
    ------
    ValueError
        If a shape, a value or the sum of the weights is not as said above.

    Examples
    --------
    A camera that turns by 0.02 radians about its vertical axis moves the picture sideways: by 18
    pixels in the middle, if its focal length is 900 pixels, and by more at the corners.

    >>> from deshake import Camera, RotationKernel
    >>> camera = Camera.from_focal(900.0, height=480, width=720)
    >>> kernel = RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera)
    >>> kernel.theta.shape[1], round(float(kernel.weights.sum()), 6)
    (3, 1.0)
    >>> round(kernel.extent_px())
    22
    >>> RotationKernel.delta(camera).weights  # a camera that stood still
    array([1.])

    """

    theta: NDArray[np.float64]
    weights: NDArray[np.float64]
    steps: NDArray[np.float64]
    camera: Camera

    def __post_init__(self) -> None:
        """Check the fields and make them read-only."""
        theta = np.array(self.theta, np.float64)
        weights = np.array(self.weights, np.float64)
        steps = np.array(self.steps, np.float64)
        if theta.ndim != 2 or theta.shape[1] != 3 or weights.shape != theta.shape[:1]:
            msg = f"rotations of shape {theta.shape} do not fit weights of shape {weights.shape}"
            raise ValueError(msg)
        if len(weights) == 0:
            msg = "a kernel has at least one rotation"
            raise ValueError(msg)
        if not (np.isfinite(theta).all() and np.isfinite(weights).all()):
            msg = "a kernel's rotations and weights are finite"
            raise ValueError(msg)
        if weights.min() < 0 or abs(weights.sum() - 1) > _SUM_TOLERANCE:
            msg = "a kernel's weights are >= 0 and sum to 1"
            raise ValueError(msg)
        if steps.shape != (3,) or not np.isfinite(steps).all() or steps.min() <= 0:
            msg = "a kernel's grid has three positive steps"
            raise ValueError(msg)
        for name, value in (("theta", theta), ("weights", weights), ("steps", steps)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @classmethod
    def delta(cls, camera: Camera, *, steps: ArrayLike | None = None) -> RotationKernel:
        """Make the kernel of a camera that stood still."""
        grid = grid_steps(camera) if steps is None else np.asarray(steps, np.float64)
        return cls(np.zeros((1, 3)), np.ones(1), grid, camera)

    @classmethod
    def from_indices(
        cls, indices: ArrayLike, weights: ArrayLike, steps: ArrayLike, camera: Camera
    ) -> RotationKernel:
        """Make a kernel from grid indices (K, 3) and weights of any positive sum.

        Weights at equal indices are added up.
        """
        unique, summed = _merge(np.asarray(indices, np.int64), np.asarray(weights, np.float64))
        grid = np.asarray(steps, np.float64)
        return cls(unique * grid, summed / summed.sum(), grid, camera)

    @classmethod
    def from_path(
        cls,
        path: ArrayLike,
        camera: Camera,
        *,
        steps: ArrayLike | None = None,
        durations: ArrayLike | None = None,
    ) -> RotationKernel:
        """Bin a camera path onto the grid by trilinear weights.

        Parameters
        ----------
        path : (T, 3) array
            Successive angle-axis orientations in radians; between two of them the camera turns
            evenly.
        camera : Camera
            The camera that moved.
        steps : (3,) array, optional
            Grid spacing in radians; by default one pixel at the edge of the frame (Sec. 7).
        durations : (T - 1,) array, optional
            Time from each orientation to the next; by default equal.

        Raises
        ------
        ValueError
            If the path is empty or not finite, or the durations do not fit.

        """
        nodes = np.asarray(path, np.float64)
        if (
            nodes.ndim != 2
            or nodes.shape[1] != 3
            or len(nodes) == 0
            or not np.isfinite(nodes).all()
        ):
            msg = "a camera path is a (T, 3) array of finite angles"
            raise ValueError(msg)
        grid = grid_steps(camera) if steps is None else np.asarray(steps, np.float64)
        if len(nodes) == 1:
            nodes = np.repeat(nodes, 2, 0)
        times = np.ones(len(nodes) - 1) if durations is None else np.asarray(durations, np.float64)
        if times.shape != (len(nodes) - 1,) or times.min() < 0 or times.sum() <= 0:
            msg = "durations are one number >= 0 for each stretch of the path"
            raise ValueError(msg)
        length = np.abs(np.diff(nodes, axis=0) / grid).max(1)
        pieces = np.maximum(np.ceil(length / _PATH_PIECE), 1).astype(np.int64)
        stretch = np.repeat(np.arange(len(pieces)), pieces)
        first = np.repeat(np.cumsum(pieces) - pieces, pieces)
        along = ((np.arange(len(stretch)) - first) + 0.5) / pieces[stretch]
        points = nodes[stretch] + along[:, None] * (nodes[stretch + 1] - nodes[stretch])
        shares = times[stretch] / pieces[stretch]
        indices, weights = _splat(points / grid, shares, ALL_AXES)
        return cls.from_indices(indices, weights, grid, camera)

    @property
    def indices(self) -> NDArray[np.int64]:
        """Nearest grid indices of the rotations, (K, 3)."""
        return np.rint(self.theta / self.steps).astype(np.int64)

    @property
    def centroid(self) -> NDArray[np.float64]:
        """Weighted mean of the rotations, (3,) in radians."""
        mean: NDArray[np.float64] = self.weights @ self.theta
        return mean

    @property
    def is_still(self) -> bool:
        """Whether the camera stands still: the kernel does not change the photo."""
        return not self.theta[self.weights > 0].any()

    def for_camera(self, camera: Camera) -> RotationKernel:
        """Return the same rotations for another camera, e.g. of a crop."""
        return replace(self, camera=camera)

    def at_size(self, height: int, width: int) -> RotationKernel:
        """Return the same kernel for the resized photo: the angles stay, K is scaled."""
        return replace(self, camera=self.camera.scaled(height, width))

    def zoomed(self, ratio: float) -> RotationKernel:
        """Return a kernel for a focal length `ratio` times as long.

        The displacements of small rotations stay the same in the middle of the frame.
        """
        shrink = np.array([1 / ratio, 1 / ratio, 1.0])
        camera = self.camera.zoomed(ratio)
        return replace(self, theta=self.theta * shrink, steps=self.steps * shrink, camera=camera)

    def centred(self) -> RotationKernel:
        """Return the kernel turned so that its centroid is the origin.

        Blurring the sharp image, turned the opposite way, gives the same photo. Under the uniform
        model the kernel moves by whole steps of its grid, and its centroid to within half a step
        of the origin: translations by parts of a pixel would blur it by interpolation.
        """
        if self.camera.is_uniform:
            offset = np.rint(self.centroid / self.steps) * self.steps
            return replace(self, theta=self.theta - offset)
        theta = self.theta
        for _ in range(3):  # the mean of angle-axis vectors is not exactly equivariant
            theta = compose(-(self.weights @ theta), theta)
        return replace(self, theta=theta)

    def turned(self, degrees: float) -> RotationKernel:
        """Return the kernel with all its directions turned clockwise about the optical axis.

        Its centroid moves to the origin. The rotations leave the grid.
        """
        turn = rotation_matrices([0, 0, np.radians(degrees)])
        return replace(self, theta=(self.theta - self.centroid) @ turn.T)

    def shifted(self, offset: ArrayLike) -> RotationKernel:
        """Return the kernel moved by whole grid steps, (3,) integers."""
        return replace(self, theta=(self.indices + np.asarray(offset)) * self.steps)

    def above(self, fraction: float) -> RotationKernel:
        """Return the kernel without the weights below `fraction` of the largest."""
        keep = self.weights >= fraction * self.weights.max()
        weights = self.weights[keep]
        return replace(self, theta=self.theta[keep], weights=weights / weights.sum())

    def resampled(
        self, steps: ArrayLike, axes: tuple[bool, bool, bool] = ALL_AXES
    ) -> RotationKernel:
        """Return the kernel on a grid of another spacing, by trilinear weights.

        Parameters
        ----------
        steps : (3,) array
            The new spacing in radians. Going finer, every weight spreads as a tent of the old
            spacing's width; going coarser, it is shared by the eight grid points around it.
        axes : three bools
            The axes that the camera may turn about; the angles about the others stay at 0.

        """
        new = np.asarray(steps, np.float64)
        ratio = self.steps / new
        finer = bool(ratio.max() > 1)
        if finer:
            indices, weights = _spread(self.indices, self.weights, ratio, axes)
        else:
            indices, weights = _splat(self.theta / new, self.weights, axes)
        return RotationKernel.from_indices(indices, weights, new, self.camera)

    def dilated(self, axes: tuple[bool, bool, bool] = ALL_AXES) -> RotationKernel:
        """Return the kernel with zero weights at all 3 x 3 x 3 neighbours of its rotations."""
        offsets = (
            np.array(np.meshgrid(*[(-1, 0, 1) if axis else (0,) for axis in axes], indexing="ij"))
            .reshape(3, -1)
            .T
        )
        around = (self.indices[:, None] + offsets).reshape(-1, 3)
        weights = np.where(np.all(offsets == 0, 1), self.weights[:, None], 0.0).ravel()
        return RotationKernel.from_indices(around, weights, self.steps, self.camera)

    def displacements(self, points: ArrayLike) -> NDArray[np.float64]:
        """Displacements (P, K, 2) in pixels of the points (P, 2), as (x, y), of the frame."""
        return displacements(homographies(self.camera, self.theta), points)

    def extent_px(self) -> float:
        """Widest spread of the displacements over the frame, along x or y, in pixels.

        Only weights above 1 % of the largest count.
        """
        return max(self.extents_px())

    def extents_px(self) -> tuple[float, float]:
        """Widest spreads of the displacements over the frame along x and y, like `extent_px`."""
        moved = self.above(0.01).displacements(self.camera.corners)
        along_x, along_y = np.ptp(moved, axis=1).max(0)
        return float(along_x), float(along_y)

    def reach_px(self) -> int:
        """Bound every displacement in the frame by rotations with a weight; taps are included."""
        return reach(self.camera, self.theta[self.weights > 0])


def _merge(
    indices: NDArray[np.int64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Add up the weights of equal indices; sorted by index."""
    if np.abs(indices).max() >= _KEY_RANGE // 2:
        msg = "a rotation lies too many grid steps from the origin"
        raise ValueError(msg)
    shifted = indices + _KEY_RANGE // 2
    keys = (shifted[:, 0] * _KEY_RANGE + shifted[:, 1]) * _KEY_RANGE + shifted[:, 2]
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    summed = np.zeros(len(first))
    np.add.at(summed, inverse.ravel(), weights)
    return indices[first], summed


def _splat(
    positions: NDArray[np.float64], weights: NDArray[np.float64], axes: tuple[bool, bool, bool]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Share each weight among the grid points around its position, (K, 3) in steps."""
    low = np.floor(positions).astype(np.int64)
    part = positions - low
    corners = np.array(np.meshgrid((0, 1), (0, 1), (0, 1), indexing="ij")).reshape(3, -1).T
    shares = np.where(corners, part[:, None], 1 - part[:, None]).prod(-1) * weights[:, None]
    indices = low[:, None] + corners
    indices[..., ~np.array(axes)] = 0
    keep = shares > 0
    return indices[keep], shares[keep]


def _spread(
    indices: NDArray[np.int64],
    weights: NDArray[np.float64],
    ratio: NDArray[np.float64],
    axes: tuple[bool, bool, bool],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Spread each weight as a tent about its place, `ratio` fine steps wide on each side."""
    fine: list[NDArray[np.int64]] = []
    share: list[NDArray[np.float64]] = []
    for axis in range(3):
        if axes[axis]:
            count = int(np.floor(2 * max(ratio[axis], 1.0))) + 1
            centre = indices[:, axis] * ratio[axis]
            first = np.ceil(centre - max(ratio[axis], 1.0)).astype(np.int64)
            place = first[:, None] + np.arange(count)
            tent = 1 - np.abs(place - centre[:, None]) / max(ratio[axis], 1.0)
        else:
            place = np.zeros((len(indices), 1), np.int64)
            tent = np.ones((len(indices), 1))
        fine.append(place)
        share.append(np.maximum(tent, 0))
    product = np.einsum("ka,kb,kc->kabc", *share) * weights[:, None, None, None]
    places = np.stack(
        np.broadcast_arrays(
            fine[0][:, :, None, None], fine[1][:, None, :, None], fine[2][:, None, None, :]
        ),
        -1,
    )
    keep = product > 0
    return places[keep], product[keep]
