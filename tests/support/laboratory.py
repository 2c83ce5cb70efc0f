"""A scene, shakes of every kind, and the photos that they make, with known truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur
from deshake.pair.denoising import NoisyPhoto, noisy_photo

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Image = NDArray[np.float32]

HEIGHT, WIDTH = 150, 190
BEYOND = 24  # pixels of the scene around the frame
CAMERA = Camera.from_focal(1.2 * WIDTH, HEIGHT, WIDTH)


def turn(ends: list[tuple[int, int, int]], camera: Camera = CAMERA) -> RotationKernel:
    """Make the kernel of a path through points in pixels at the edge of the frame, centred."""
    return RotationKernel.from_path(np.array(ends) * grid_steps(camera), camera).centred()


def _kernels() -> dict[str, RotationKernel]:
    return {
        "uniform": turn([(0, 0, 0), (6, 2, 0), (8, 7, 0)], Camera.uniform(HEIGHT, WIDTH)),
        "pan": turn([(0, 0, 0), (2, 9, 0)]),
        "roll": turn([(0, 0, -7), (0, 0, 7)]),
        "all": turn([(0, 0, 0), (5, 3, 4), (2, 8, 9)]),
    }


@dataclass(frozen=True)
class Laboratory:
    """Makes shaken photos, and measures results."""

    shape: tuple[int, int] = (HEIGHT, WIDTH)
    camera: Camera = CAMERA
    kernels: dict[str, RotationKernel] = field(default_factory=_kernels)

    @property
    def all_axes(self) -> RotationKernel:
        """The kernel of a shake about all three axes."""
        return self.kernels["all"]

    @staticmethod
    def scene(seed: int = 5) -> Image:
        """Discs and bars of many sizes and greys on a ramp, .1 to .8, float32."""
        rng = np.random.default_rng(seed)
        height, width = HEIGHT + 2 * BEYOND, WIDTH + 2 * BEYOND
        out = np.tile(np.linspace(0.2, 0.5, width, dtype=np.float32), (height, 1))
        for _ in range(90):
            x, y = int(rng.integers(width)), int(rng.integers(height))
            dx, dy = (int(d) for d in rng.integers(-15, 16, 2))
            level = float(rng.uniform(0.1, 0.8))
            if rng.random() < 0.5:
                cv2.circle(out, (x, y), int(rng.integers(2, 12)), level, -1, cv2.LINE_AA)
            else:
                cv2.line(out, (x, y), (x + dx, y + dy), level, int(rng.integers(1, 4)), cv2.LINE_AA)
        return out

    @staticmethod
    def colours() -> Image:
        """A scene of three independent colours."""
        return np.stack([Laboratory.scene(seed) for seed in (5, 6, 7)], -1)

    @staticmethod
    def noisy_photo(g: Image, f_N: Image, valid: Image | None = None) -> NoisyPhoto:
        """Denoise a noisy photo that lies in the blurred one's frame, or reaches over it."""
        seen = np.ones(f_N.shape[:2], np.float32) if valid is None else valid
        return noisy_photo(g, f_N, lambda image: (image, seen))[0]

    @staticmethod
    def frame(image: Image) -> Image:
        """Cut the frame out of a scene."""
        return image[BEYOND:-BEYOND, BEYOND:-BEYOND]

    @staticmethod
    def shaken(kernel: RotationKernel, sharp: Image) -> Image:
        """Blur a scene exactly."""
        return ShakeBlur(kernel, margin=BEYOND, kind="warps").forward(sharp)

    @staticmethod
    def noisy(image: Image, sigma: float, seed: int = 1) -> Image:
        """Add white noise, and clip."""
        rng = np.random.default_rng(seed)
        return np.clip(image + rng.normal(0, sigma, image.shape), 0, 1).astype(np.float32)

    @staticmethod
    def psnr(a: Image, b: Image) -> float:
        """Peak signal-to-noise ratio in dB."""
        return float(-10 * np.log10(np.mean(np.square(a.astype(np.float64) - b))))

    def lamps(self) -> tuple[Image, Image, NDArray[np.bool_], NDArray[np.bool_]]:
        """A dim scene with lamps of eight times the clip level.

        The scene, the photo, where it clipped, and the dim pixels around there.
        """
        sharp = self.scene(4) * 0.3
        for x, y in ((70, 60), (150, 90), (110, 130), (180, 50)):
            cv2.circle(sharp, (x, y), 4, 8.0, -1, cv2.LINE_AA)
        g = self.noisy(self.shaken(self.all_axes, sharp), 0.002)
        clipped = g >= 0.99
        around = cv2.dilate(clipped.astype(np.uint8), np.ones((25, 25))) > 0
        return sharp, g, clipped, around & (self.frame(sharp) < 0.5)


@pytest.fixture(scope="session")
def lab() -> Laboratory:
    return Laboratory()
