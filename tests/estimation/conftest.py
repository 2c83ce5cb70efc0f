"""Dense counterparts of the estimator's maps, and a shaken photograph."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.geometry.rotations import homographies

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.geometry.camera import Camera


def _dense_weights(camera: Camera, theta: np.ndarray) -> np.ndarray:
    """Bilinear weights ``C_ijk``, (N, N, K), pixel by pixel; beyond the frame all is zero."""
    height, width = camera.shape
    count = height * width
    out = np.zeros((count, count, len(theta)))
    for k, h in enumerate(homographies(camera, theta)):
        for i in range(count):
            x, y, z = h @ [i % width, i // width, 1]
            left, top = np.floor(x / z), np.floor(y / z)
            for u, a in ((left, 1 - x / z + left), (left + 1, x / z - left)):
                for v, b in ((top, 1 - y / z + top), (top + 1, y / z - top)):
                    if 0 <= u < width and 0 <= v < height:
                        out[i, int(v) * width + int(u), k] += a * b
    return out


@pytest.fixture(scope="session")
def dense_weights() -> Callable[[Camera, np.ndarray], np.ndarray]:
    return _dense_weights


@pytest.fixture(scope="session")
def sharp() -> np.ndarray:
    """A photograph in linear light, 0..1, (200, 260), sharp to the last pixel."""
    grey = data.coffee()[:, 40:560] @ np.array([0.3, 0.59, 0.11]) / 255
    small = cv2.resize(grey, (260, 200), interpolation=cv2.INTER_AREA)
    return (small**2.2).astype(np.float32)
