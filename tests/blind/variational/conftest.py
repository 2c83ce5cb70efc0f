"""The dense counterpart of the estimator's maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

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
