from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deshake.blind.entry import Entry
from deshake.blind.soft_scene import without_softness
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.signal.pyramid import RATIO

LARGE = Camera.from_focal(3000.0, 2400, 3200)
BENT = np.array([[-8.0, -6, -1], [0, -3, 0], [7, 2, 1], [9, 6, 1]])


def entry(pixels: np.ndarray, camera: Camera = LARGE, level: int = 0) -> Entry:
    """A kernel of the path, given in pixels, on the grid of a scale."""
    steps = grid_steps(camera)
    grid = steps * RATIO**level
    kernel = RotationKernel.from_path(pixels * steps, camera, steps=grid).centred()
    return Entry("path", 0, level, kernel)


def softened(path: Entry, pixels: float) -> Entry:
    """The kernel as an estimate sees it in a photo that is soft: as wide as a round spot."""
    grid = path.kernel.steps
    offsets = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 2, indexing="ij"), -1).reshape(-1, 2)
    offsets = np.column_stack([offsets, np.zeros(len(offsets))])
    share = np.exp(-0.5 * (offsets**2).sum(1) / pixels**2)
    index = np.rint((path.kernel.theta / grid)[:, None] + offsets).reshape(-1, 3)
    weights = np.outer(path.kernel.weights, share / share.sum()).ravel()
    places, where = np.unique(index, axis=0, return_inverse=True)
    sums = np.bincount(where.ravel(), weights)
    kept = sums > 1e-3
    wide = replace(path.kernel, theta=places[kept] * grid, weights=sums[kept] / sums[kept].sum())
    return path._replace(kernel=wide.centred())


def width_across(kernel: RotationKernel, pixels: np.ndarray) -> float:
    """The root mean square distance of the rotations from the path, in pixels."""
    time = np.linspace(0, len(pixels) - 1, 300)
    curve = np.stack([np.interp(time, np.arange(len(pixels)), axis) for axis in pixels.T], 1)
    places = (kernel.theta - kernel.centroid) / grid_steps(kernel.camera)
    apart = np.linalg.norm(places[:, None] - (curve - curve.mean(0)), axis=2).min(1)
    return float(np.sqrt(kernel.weights @ apart**2))


@pytest.mark.parametrize("level", [0, 1])
def test_a_band_in_a_large_photo_becomes_a_path_again(level) -> None:
    band = softened(entry(BENT, level=level), 1.2)
    thin = without_softness(band)
    assert width_across(thin, BENT) < 0.6 * width_across(band.kernel, BENT)
    assert thin.weights.sum() == pytest.approx(1)
    assert thin.extent_px() > 0.7 * band.kernel.extent_px()
    np.testing.assert_allclose(thin.centroid, 0, atol=0.5 * grid_steps(LARGE).max())


def test_a_path_remains_as_it_is() -> None:
    path = entry(BENT)
    assert without_softness(path) is path.kernel


def test_a_band_in_a_smaller_photo_remains() -> None:
    small = Camera.from_focal(1500.0, 1200, 1600)
    band = softened(entry(BENT, small), 1.2)
    assert without_softness(band) is band.kernel


def test_a_wide_shake_remains() -> None:
    band = softened(entry(3 * BENT), 1.2)
    assert without_softness(band) is band.kernel


def test_a_camera_that_stood_still_remains() -> None:
    still = Entry("still", 0, 0, RotationKernel.delta(LARGE, steps=grid_steps(LARGE)))
    assert without_softness(still) is still.kernel


def test_a_disk_remains() -> None:
    y, x = np.mgrid[-11:12, -11:12]
    inside = x**2 + y**2 <= 121
    theta = np.stack([x[inside], y[inside], 0 * x[inside]], 1) * grid_steps(LARGE)
    weights = np.full(len(theta), 1 / len(theta))
    disk = replace(entry(BENT).kernel, theta=theta, weights=weights)
    assert without_softness(Entry("disk", 0, 0, disk)) is disk
