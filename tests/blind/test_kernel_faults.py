from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.kernel_faults import (
    COLLAPSED,
    FILLED,
    SCATTERED,
    TOUCHING,
    faults,
)
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

CAMERA = Camera.from_focal(300.0, 200, 300)
STEPS = grid_steps(CAMERA)


def kernel(indices: np.ndarray, weights: np.ndarray | None = None) -> RotationKernel:
    shares = np.ones(len(indices)) if weights is None else weights
    return RotationKernel.from_indices(indices, shares, STEPS, CAMERA).centred()


def path(length: int) -> np.ndarray:
    """Grid indices of a turn about all axes, a step at a time."""
    along = np.arange(length + 1)
    return np.stack([along // 2, along, along // 3], 1)


def test_a_path_within_its_bounds_is_faultless() -> None:
    assert faults(kernel(path(20))) == []
    assert faults(kernel(path(20)), blur_px=24) == []


def test_a_point_is_no_shake() -> None:
    assert faults(RotationKernel.delta(CAMERA)) == [COLLAPSED]
    assert faults(kernel(path(2), np.array([1.0, 3, 1]))) == [COLLAPSED]
    tail = np.array([1.0] + [0.005] * 20)
    assert faults(kernel(path(20), tail)) == [COLLAPSED]
    assert faults(kernel(path(20), tail + 0.02)) == []


@pytest.mark.parametrize(("blur_px", "expected"), [(24, []), (19, []), (12, [TOUCHING])])
def test_the_bounds_that_were_given_count(blur_px: float, expected: list[str]) -> None:
    assert faults(kernel(path(20)), blur_px=blur_px) == expected


def test_without_bounds_a_kernel_must_not_run_away() -> None:
    assert faults(kernel(path(50))) == []
    assert faults(kernel(path(90))) == [TOUCHING]


def test_bounds_are_pixels_of_the_photo_at_any_size() -> None:
    small = kernel(path(20))
    photo = Camera.from_focal(1200.0, 800, 1200)
    large = small.for_camera(photo)
    assert faults(large, blur_px=96) == []
    assert faults(large, blur_px=48) == [TOUCHING]


def test_scattered_weights_are_noise() -> None:
    rng = np.random.default_rng(0)
    specks = rng.integers(-20, 21, (30, 3)) * (1, 1, 0)
    assert faults(kernel(specks)) == [SCATTERED]
    gap = np.concatenate([path(8), path(8) + np.array([4, 10, 2])])  # the camera rushed on
    assert faults(kernel(gap)) == []
    heavy = np.concatenate([np.full(21, 0.1), np.full(30, 0.01)])
    assert faults(kernel(np.concatenate([path(20), specks - (0, 10, 0)]), heavy)) == []


@pytest.mark.parametrize("radius", [1.6, 2.5, 4, 7])
def test_a_filled_disk_is_a_photo_out_of_focus(radius: float) -> None:
    x, y = np.meshgrid(np.arange(-8, 9), np.arange(-8, 9))
    inside = x**2 + y**2 <= radius**2
    disk = np.stack([x[inside], y[inside], 0 * x[inside]], 1)
    assert faults(kernel(disk)) == [FILLED]
    ring = inside & (x**2 + y**2 > (radius - 1.2) ** 2)
    if radius > 2:
        assert faults(kernel(np.stack([x[ring], y[ring], 0 * x[ring]], 1))) == []


def test_paths_are_no_disks_however_they_wind() -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        steps = np.cumsum(np.cumsum(rng.normal(size=(60, 3)), 0), 0)
        steps *= 6 / np.abs(steps - steps.mean(0)).max()
        winding = np.rint(steps).astype(int)
        assert FILLED not in faults(kernel(winding))
