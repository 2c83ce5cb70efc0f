"""One dot-test for every operator, photographs, and a small camera with its rotations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from bench.cases.shipped import SHIPPED

from deshake.geometry.camera import Camera
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float32]


def _relative_error(
    forward: Callable[[Array], Array],
    adjoint: Callable[[Array], Array],
    shape: tuple[int, ...],
    observed: tuple[int, ...],
    seed: int = 0,
) -> float:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=shape).astype(np.float32)
    y = rng.normal(size=observed).astype(np.float32)
    out, back = forward(x), adjoint(y)
    assert out.shape == observed
    assert back.shape == shape
    left = np.vdot(out.astype(np.float64), y.astype(np.float64))
    right = np.vdot(x.astype(np.float64), back.astype(np.float64))
    # noise may be orthogonal by chance: its products are measured by their spread, too
    spread = np.linalg.norm(out) * np.linalg.norm(y) / np.sqrt(y.size)
    return float(abs(left - right) / max(abs(left), abs(right), spread))


@pytest.fixture
def dot_test() -> Callable[..., float]:
    """Relative error of ``<A x, y> = <x, A' y>`` for float32 noise x, y of the shapes given."""
    return _relative_error


@pytest.fixture(scope="session")
def photo() -> Array:
    """Four photographs side by side in linear light, (768, 1024): sharp to the last pixel."""
    parts = [
        SHIPPED["astronaut"]()[:384, :512],
        np.repeat(SHIPPED["camera"]()[64:448, :, None], 3, 2),
        SHIPPED["coffee"]()[:384, :512],
        SHIPPED["china"]()[:384, :512],
    ]
    grey = [part[..., :3] @ np.array([0.3, 0.59, 0.11]) / 255 for part in parts]
    light = np.vstack([np.hstack(grey[:2]), np.hstack(grey[2:])]) ** 2.2
    return light.astype(np.float32)


@pytest.fixture(scope="session")
def camera() -> Camera:
    """Make a camera of odd size whose frame is no whole number of patches."""
    return Camera.from_focal(110.0, 75, 101)


@pytest.fixture(scope="session")
def theta(camera: Camera) -> NDArray[np.float64]:
    """Rotations about all axes, off the grid, (7, 3)."""
    return np.random.default_rng(1).normal(size=(7, 3)) * 3 * grid_steps(camera)


@pytest.fixture(scope="session")
def weights(theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights (7,) that sum to one."""
    weights = np.random.default_rng(2).random(len(theta))
    return weights / weights.sum()
