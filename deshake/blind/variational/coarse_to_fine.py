"""From coarse to fine: the pyramid, and the active region of the kernel (Sec. 7).

The estimate begins on a picture so small that the blur is about three pixels wide, and continues on
finer ones, each larger by sqrt(2). Between two scales the kernel loses its smallest weights, is
moved until its centroid is the origin, is resampled, and grows by one step on every side. The finer
scale estimates this active region only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.variational.settings import SETTINGS
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps, homographies

if TYPE_CHECKING:
    from deshake.geometry.camera import Camera

__all__ = [
    "Level",
    "PyramidPlan",
    "first_kernel",
    "latent_differences",
    "next_kernel",
    "resize",
    "turn",
    "turned_gradients",
    "warped",
]

Image = NDArray[np.float32]

RATIO = np.sqrt(2)  # of the sides of two neighbouring scales


@dataclass(frozen=True, eq=False)
class Level:
    """One scale: its camera, its grid, and the box that the kernel may fill.

    Parameters
    ----------
    index : int
        0 is the finest scale; one more is a factor of sqrt(2).
    camera : Camera
        The camera of the resized photo.
    steps : (3,) array
        Grid spacing in radians: one pixel at the edge of the frame.
    half : (3,) array of int
        Largest index of the grid about each axis.

    """

    index: int
    camera: Camera
    steps: NDArray[np.float64]
    half: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PyramidPlan:
    """The scales of an estimate.

    Parameters
    ----------
    camera : Camera
        The camera at the finest scale.
    blur_px : float
        Bound of the blur at the finest scale, in pixels.
    axes : three bools
        The axes that the camera may turn about.

    """

    camera: Camera
    blur_px: float
    axes: tuple[bool, bool, bool] = ALL_AXES

    def levels(self) -> list[Level]:
        """Return the scales from coarse to fine."""
        half = int(self.blur_px) // 2 + 2
        count = int(np.ceil(2 * np.log2((2 * half + 1) / SETTINGS.coarsest_blur))) + 1
        height, width = self.camera.shape
        while count > 1 and min(height, width) / RATIO ** (count - 1) < SETTINGS.smallest_side:
            count -= 1
        return [self._level(index, half) for index in range(count - 1, -1, -1)]

    def _level(self, index: int, half: int) -> Level:
        scale = RATIO**-index
        height, width = self.camera.shape
        camera = self.camera.scaled(max(round(height * scale), 1), max(round(width * scale), 1))
        reach = max(int(np.ceil((half + 0.5) * scale - 0.5)), 1)
        box = np.where(self.axes, reach, 0)
        # the same steps as at the finest scale, coarsened: indices stay comparable
        return Level(index, camera, grid_steps(self.camera) / scale, box)


def first_kernel(level: Level) -> RotationKernel:
    """Return the neutral start, a cube of 3 x 3 x 3, dilated to its whole box."""
    axes = [np.arange(-half, half + 1) for half in level.half]
    indices = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    weights = np.where(np.abs(indices).max(1) <= 1, 1.0, 0.0)
    return RotationKernel.from_indices(indices, weights, level.steps, level.camera)


def next_kernel(
    kernel: RotationKernel, level: Level, axes: tuple[bool, bool, bool], *, cut: float
) -> tuple[RotationKernel, NDArray[np.int64]]:
    """Carry a kernel to the next scale: cut, recentre, resample, dilate.

    Returns
    -------
    kernel : RotationKernel
        The active region at the next scale, zero weights included.
    offset : (3,) array of int
        The grid steps by which the kernel was moved, at the scale that it came from.

    """
    kept = kernel.above(cut)
    offset = -np.rint(kept.centroid / kept.steps).astype(np.int64)
    finer = kept.shifted(offset).for_camera(level.camera).resampled(level.steps, axes)
    active = finer.dilated(axes)
    inside = np.all(np.abs(active.indices) <= level.half, 1)
    return (
        RotationKernel.from_indices(
            active.indices[inside], active.weights[inside], level.steps, level.camera
        ),
        offset,
    )


def turn(image: Image, camera: Camera, theta: NDArray[np.float64]) -> Image:
    """Turn a picture (C, h, w): the result at x is the picture at ``H(theta) x``."""
    return warped(image, camera, homographies(camera, theta))


def warped(image: Image, camera: Camera, h: NDArray[np.float64]) -> Image:
    """Warp a picture (C, h, w) by a homography: the result at x is the picture at ``H x``."""
    size = (camera.width, camera.height)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.stack([cv2.warpPerspective(c, h, size, flags=flags) for c in image])


def latent_differences(f: Image, level: Level, theta: NDArray[np.float64]) -> Image:
    """Return the latent gradients as differences of the scale's own pixels, turned by `theta`.

    A scale's gradients `f` are reduced as a picture is: they are differences of the finest pixels.
    They lie half a finest pixel right of, or below, the centre of a coarse pixel. Differences of
    coarse pixels lie half a coarse pixel from it.
    """
    coarser = RATIO**level.index
    ahead = (1 - 1 / coarser) / 2
    return turned_gradients(f, level.camera, theta, ahead=ahead) * np.float32(coarser)


def turned_gradients(
    gradients: Image, camera: Camera, theta: NDArray[np.float64], *, ahead: float = 0.0
) -> Image:
    """Turn the gradients (2, h, w) of a picture by a small rotation; beyond the frame they are 0.

    Gradients across are sampled `ahead` pixels further right, gradients down further down.
    """
    h = homographies(camera, theta)
    size = (camera.width, camera.height)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    out = np.empty_like(gradients)
    for axis in (0, 1):
        place = np.eye(3)
        place[axis, 2] = ahead
        cv2.warpPerspective(gradients[axis], h @ place, size, out[axis], flags=flags)
    return out


def resize(image: Image, shape: tuple[int, int]) -> Image:
    """Resize (C, h, w): by area when it shrinks, bilinearly when it grows."""
    if image.shape[1:] == shape:
        return image
    shrinks = shape[0] < image.shape[1]
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    size = (shape[1], shape[0])
    planes = [np.ascontiguousarray(c) for c in image]
    return np.stack([cv2.resize(c, size, interpolation=method) for c in planes])
