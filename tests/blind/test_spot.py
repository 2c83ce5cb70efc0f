from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.spot import axes_px, is_spot
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

CAMERA = Camera.from_focal(400.0, 300, 400)
STEPS = grid_steps(CAMERA)


def path(*nodes) -> RotationKernel:
    return RotationKernel.from_path(np.array(nodes, float) * STEPS, CAMERA)


def round_spot(sigma: float, flat: float = 1.0) -> RotationKernel:
    """A Gaussian of a standard deviation in pixels; `flat` is that along X over that along Y."""
    x, y = np.mgrid[-8:9, -8:9].reshape(2, -1)
    weights = np.exp(-((x / (flat * sigma)) ** 2 + (y / sigma) ** 2) / 2)
    return RotationKernel.from_indices(np.stack([x, y, 0 * x], 1), weights, STEPS, CAMERA)


def test_axes_of_a_gaussian() -> None:
    longer, shorter = axes_px(round_spot(2.0, 0.5))
    assert longer == pytest.approx(2, rel=0.01)
    assert shorter == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0])
def test_axes_of_a_straight_path_of_any_direction(angle) -> None:
    end = 12 * np.array([np.cos(angle), np.sin(angle), 0])
    longer, shorter = axes_px(path(-end, end))
    assert longer == pytest.approx(24 / np.sqrt(12), rel=0.03)
    assert shorter < 0.5


def test_axes_do_not_depend_on_where_the_camera_pointed_or_its_roll() -> None:
    kernel = round_spot(1.5)
    turned = RotationKernel(
        kernel.theta + np.array([0.1, -0.2, 0.3]), kernel.weights, STEPS, CAMERA
    )
    assert axes_px(turned) == pytest.approx(axes_px(kernel), rel=1e-6)


@pytest.mark.parametrize(
    "kernel",
    [
        RotationKernel.delta(CAMERA),
        path([0, 0, 0], [0, 1, 0]),
        round_spot(0.8),
        round_spot(1.1),
        round_spot(1.1, 0.8),
    ],
    ids=["still", "a pixel", "round", "rounder", "nearly round"],
)
def test_what_is_small_and_round_is_a_spot(kernel) -> None:
    assert is_spot(kernel)


@pytest.mark.parametrize(
    "kernel",
    [
        path([0, -2, 0], [0, 2, 0]),
        path([-4, -4, 0], [4, 4, 0]),
        round_spot(3.0),
        path([0, 0, 0], [0, 20, 0], [20, 20, 0]),
    ],
    ids=["a short path", "a path", "a disk", "a corner"],
)
def test_what_is_long_or_large_is_none(kernel) -> None:
    assert not is_spot(kernel)


def test_it_counts_in_pixels_of_the_kernels_own_photo() -> None:
    spot = round_spot(0.8)
    assert is_spot(spot)
    assert not is_spot(spot.at_size(1500, 2000))
