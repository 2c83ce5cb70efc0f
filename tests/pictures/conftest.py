"""Kernels of every shape that there is to draw."""

from __future__ import annotations

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

CAMERA = Camera.from_focal(900, 600, 800)


def line(axis: int, length: int, camera: Camera = CAMERA) -> RotationKernel:
    """An even rotation about one axis, `length` pixels at the edge of the frame, centred."""
    indices = np.zeros((length + 1, 3), int)
    indices[:, axis] = np.arange(length + 1) - length // 2
    return RotationKernel.from_indices(indices, np.ones(length + 1), grid_steps(camera), camera)


@pytest.fixture
def kernels() -> dict[str, RotationKernel]:
    steps = grid_steps(CAMERA)
    rng = np.random.default_rng(7)
    cloud = np.rint(rng.normal(size=(60_000, 3)) * (16, 12, 9)).astype(int)
    far = RotationKernel(line(0, 8).theta + np.array((0.2, 0, 0)), np.full(9, 1 / 9), steps, CAMERA)
    path = np.cumsum(rng.normal(size=(30, 3)), 0) * steps
    return {
        "delta": RotationKernel.delta(CAMERA),
        "flat": line(1, 20),
        "roll": line(2, 20),
        "path": RotationKernel.from_path(path, CAMERA).centred(),
        "far": far,
        "uniform": line(0, 12, Camera.uniform(600, 800)),
        "cloud": RotationKernel.from_indices(cloud, rng.random(60_000), steps, CAMERA),
    }
