"""A shaken photo by night: a dark scene with lamps, which draw the path of the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from skimage import data

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.operators.shake_blur import ShakeBlur

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEIGHT, WIDTH = 150, 200
CAMERA = Camera.from_focal(1.25 * WIDTH, HEIGHT, WIDTH)
PATH = np.array([(-12, -6, -3), (-2, 2, -1), (4, -4, 1), (10, 9, 3)]) / 500  # radians
LAMPS = [(25, 31), (31, 156), (75, 94), (112, 38), (119, 169), (69, 138), (125, 100)]


def kernel_of(path: NDArray[np.float64]) -> RotationKernel:
    """Return the kernel of a path (n, 3) of rotations in radians."""
    return RotationKernel.from_path(path, CAMERA).centred()


def night(
    kernel: RotationKernel,
    lamps: list[tuple[int, int]] = LAMPS,
    light: float = 150.0,
    seed: int = 0,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Render a dark scene with lamps, shaken, clipped and noisy; return it and what clipped."""
    blur = ShakeBlur(kernel)
    m = blur.margin
    grey = data.camera()[100 : 100 + HEIGHT + 2 * m, 100 : 100 + WIDTH + 2 * m]
    scene = 0.15 * (grey.astype(np.float32) / 255) ** 2.2
    points = np.zeros_like(scene)
    for number, (y, x) in enumerate(lamps):
        points[y + m, x + m] = light * (1 + number % 3)
    scene = scene + cv2.GaussianBlur(points, (0, 0), 0.8)
    noise = np.random.default_rng(seed).normal(0, 2e-3, CAMERA.shape)
    g = np.clip(blur.forward(scene.astype(np.float32)) + noise, 0, 1).astype(np.float32)
    return g, g >= 1
