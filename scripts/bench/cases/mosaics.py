"""Mosaics of any size, shaken along random paths: what the tables of cost deblur.

A mosaic of a photo in colour, which a development dependency ships, is blurred along a random path
about all three axes and gets white noise; nothing clips. A kernel has the rotations of the camera's
grid that lie nearest to such a path. The fewer rotations, the longer the path: the extent is the
same.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skimage import data

from bench.processes import apart
from deshake.formats.transfer import Srgb, decode
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.filter_flow import FilterFlow
from deshake.simulation.shake_path import random_path

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["RATIO", "Mosaic", "alone", "short_exposure"]

Image = NDArray[np.float32]

SIGMA = 0.005
BRIGHTEST = np.float32(0.8)  # of the sharp scene, so that nothing clips
PATH_SAMPLES = 2000  # several in each step of the grid
RATIO = np.float32(16)  # of a long and a short exposure
SHORT_SIGMA = np.float32(0.05)  # of the short one's noise, as bright as the long one


class Mosaic(NamedTuple):
    """Megapixels of the photo, pixels that its blur extends over, rotations of its kernel."""

    megapixels: float
    extent: float
    rotations: int

    def kernel(self) -> RotationKernel:
        """Make the kernel of equal weights, for a camera that takes photos of 3:2."""
        height = round((self.megapixels * 1e6 / 1.5) ** 0.5)
        width = round(1.5 * height)
        camera = Camera.from_focal(width, height, width)
        steps = grid_steps(camera)
        path = random_path(camera, self.extent, samples=PATH_SAMPLES).theta / steps
        for _ in range(5):
            passed = np.rint(path)
            near = RotationKernel.from_indices(passed, np.ones(len(path)), steps, camera)
            while len(near.weights) < self.rotations:
                near = near.dilated()
            away, _ = cKDTree(path).query(near.indices)
            nearest = near.indices[np.argsort(away, kind="stable")[: self.rotations]]
            kernel = RotationKernel.from_indices(nearest, np.ones(len(nearest)), steps, camera)
            path *= self.extent / kernel.extent_px()
        return kernel


def sharp_scene(shape: tuple[int, int]) -> Image:
    """Return the sharp scene (h, w, 3) in linear light."""
    tile = decode(data.astronaut(), Srgb()) * BRIGHTEST
    tile = cv2.resize(tile, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    more = [(0, max(side - n, 0)) for side, n in zip(shape, tile.shape, strict=False)]
    return np.pad(tile, [*more, (0, 0)], mode="symmetric")[: shape[0], : shape[1]]


def write_photo(mosaic: Mosaic, file: Path) -> None:
    """Blur a mosaic and write it as an array of linear light."""
    kernel = mosaic.kernel()
    flow = FilterFlow(kernel.camera, kernel.theta, channels=3)
    photo = flow.blur(sharp_scene(flow.latent_shape), kernel.weights)
    noise = np.random.default_rng(0).standard_normal(photo.shape, np.float32)
    np.save(file, np.clip(photo + np.float32(SIGMA) * noise, 0, 1))


def short_exposure(kernel: RotationKernel) -> Image:
    """Return the sharp mosaic that a kernel blurred, noisy and dark."""
    latent = FilterFlow(kernel.camera, kernel.theta, channels=3).latent_shape
    (height, width), (high, wide) = kernel.camera.shape, latent
    top, left = (high - height) // 2, (wide - width) // 2
    sharp = sharp_scene(latent)[top : top + height, left : left + width]
    noise = np.random.default_rng(1).standard_normal(sharp.shape, np.float32)
    return (sharp + SHORT_SIGMA * noise) / RATIO


def alone(work: Callable[..., Any], mosaic: Mosaic, how: str, threads: int) -> Any:  # noqa: ANN401
    """Make a photo in one new process and do some work on it in another."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "photo.npy"
        apart(write_photo, mosaic, file)
        return apart(work, mosaic, file, how, threads)
