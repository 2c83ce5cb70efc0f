"""A small scene, shaken, with what is known about it."""

from __future__ import annotations

import numpy as np
import pytest

import deshake


@pytest.fixture(scope="session")
def scene() -> np.ndarray:
    """Grey squares (96, 128), read-only: nothing may write into what it is given."""
    squares = np.random.default_rng(0).random((12, 16)).repeat(8, 0).repeat(8, 1)
    squares = squares.astype(np.float32)
    squares.setflags(write=False)
    return squares


@pytest.fixture(scope="session")
def camera(scene: np.ndarray) -> deshake.Camera:
    return deshake.Camera.from_focal(120.0, *scene.shape)


@pytest.fixture(scope="session")
def shaken(scene: np.ndarray, camera: deshake.Camera) -> deshake.Simulation:
    shaken = deshake.simulate(scene, camera, blur_px=4, seed=1)
    shaken.blurred.setflags(write=False)
    return shaken


@pytest.fixture(scope="session")
def noisy(shaken: deshake.Simulation) -> np.ndarray:
    dark = 0.25 * shaken.sharp
    dark += np.random.default_rng(1).normal(0, 0.01, dark.shape).astype(np.float32)
    dark.setflags(write=False)
    return dark
