from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from deshake.blind.agreement import agreement, spread_px
from deshake.blind.camera_path import SmoothPath, _settled, filled_path, thinned
from deshake.blind.settings import SETTINGS
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

CAMERA = Camera.from_focal(2000.0, 1200, 1600)
STEPS = grid_steps(CAMERA)  # of one pixel
PATH = np.array([[-20.0, -60, -9], [10, 0, 0], [35, 10, 6], [30, 70, 20]])


def smooth_path(kernel: RotationKernel, scale: Camera) -> RotationKernel:
    """The smooth path through a kernel, where the kernel is."""
    path = SmoothPath.through(kernel, scale)[0]
    assert path is not None
    smooth = path.kernel(kernel.camera)
    np.testing.assert_allclose(smooth.centroid, 0, atol=1e-9)
    return replace(smooth, theta=smooth.theta + kernel.centroid)


def coarse(ratio: float, path: np.ndarray = PATH) -> RotationKernel:
    """A path on a grid of so many pixels, off the grid as `centred` leaves it."""
    kernel = RotationKernel.from_path(path * STEPS, CAMERA, steps=ratio * STEPS)
    return replace(kernel, theta=kernel.theta - kernel.centroid)


def hangs_together(kernel: RotationKernel, pixels: float) -> bool:
    """Whether steps of so many pixels lead from any rotation to any other."""
    tree = KDTree(kernel.theta / STEPS)
    near = tree.sparse_distance_matrix(tree, pixels + 1e-6, p=np.inf)
    return connected_components(near)[0] == 1


@pytest.mark.parametrize(("ratio", "roll"), [(2.0, 1), (2.83, 1), (4.0, 0), (5.0, 0)])
def test_no_holes_are_left(ratio, roll) -> None:
    kernel = coarse(ratio, PATH * [1, 1, roll]).above(0.05)
    assert not hangs_together(kernel, 0.9 * ratio)
    filled = filled_path(kernel)
    assert hangs_together(filled, 1.5)
    assert (filled.steps < 1.5 * STEPS).all()


@pytest.mark.parametrize("ratio", [2.0, 4.0, 11.3])
def test_the_camera_points_where_it_did_and_the_exposure_is_whole(ratio) -> None:
    kernel = coarse(ratio)
    filled = filled_path(kernel)
    np.testing.assert_allclose(filled.centroid, kernel.centroid, atol=1e-9)
    assert filled.weights.sum() == pytest.approx(1)
    assert filled.weights.min() > 0
    assert filled.camera is CAMERA


@pytest.mark.parametrize("ratio", [2.0, 4.0])
def test_the_path_stays_what_it_was(ratio) -> None:
    kernel = coarse(ratio)
    filled = filled_path(kernel)
    true = RotationKernel.from_path(PATH * STEPS, CAMERA)
    assert spread_px(filled) == pytest.approx(spread_px(kernel), rel=0.03)
    assert agreement(filled, true, smoothing=0.1) > 0.95
    away = cdist(filled.theta, kernel.theta).min(1)
    assert away.max() < ratio * np.linalg.norm(STEPS)


def test_a_straight_path_gets_no_wider_across() -> None:
    filled = filled_path(coarse(4.0, np.array([[0.0, -40, 0], [0, 40, 0]])))
    np.testing.assert_allclose(filled.theta[:, [0, 2]], 0, atol=1e-12)
    assert len(filled.theta) > 60


def test_heavy_rotations_stay_heavy() -> None:
    places = [[0, i, 0] for i in range(9)]
    kernel = RotationKernel.from_indices(places, [1] * 4 + [20] + [1] * 4, 4 * STEPS, CAMERA)
    filled = filled_path(kernel)
    near = np.abs(filled.theta[:, 1] - kernel.theta[4, 1]) < 6 * STEPS[1]
    assert filled.weights[near].sum() > 0.7


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.41])
def test_fine_kernels_are_left_alone(ratio) -> None:
    kernel = coarse(ratio)
    assert filled_path(kernel) is kernel


def test_a_lone_rotation_stays() -> None:
    still = RotationKernel.delta(CAMERA, steps=8 * STEPS)
    assert filled_path(still) is still
    places = [[0, 0, 0], [0, 1, 0], [0, 2, 0], [9, 9, 0]]
    kernel = RotationKernel.from_indices(places, [3, 3, 3, 1], 4 * STEPS, CAMERA)
    filled = filled_path(kernel)
    far = filled.theta[:, 0] > 20 * STEPS[0]
    assert filled.weights[far] == pytest.approx([0.1])


def test_wide_kernels_get_no_more_rotations_than_can_be_restored() -> None:
    rng = np.random.default_rng(0)
    places = np.unique(rng.integers(-4, 5, (300, 3)), axis=0)
    kernel = RotationKernel.from_indices(places, rng.random(len(places)), 16 * STEPS, CAMERA)
    pairs = (cdist(places, places, "chebyshev") == 1).sum()
    assert len(filled_path(kernel).weights) <= max(pairs, 1500) + len(places)


def smeared(path: np.ndarray, seed: int = 0) -> RotationKernel:
    """Smear a path by 1.2 pixels about every axis, as an estimate is."""
    true = RotationKernel.from_path(path * STEPS, CAMERA)
    rng = np.random.default_rng(seed)
    theta = np.repeat(true.theta, 2, 0)
    theta = theta + rng.normal(0, 1.2, theta.shape) * STEPS
    scattered = RotationKernel(theta, np.repeat(true.weights, 2) / 2, STEPS, CAMERA)
    return scattered.resampled(STEPS)


def off(kernel: RotationKernel, path: np.ndarray) -> float:
    """Mean distance of a kernel's rotations from a path, in pixels."""
    fine = RotationKernel.from_path(path * STEPS, CAMERA).theta / STEPS
    return float(kernel.weights @ cdist(kernel.theta / STEPS, fine).min(1))


@pytest.mark.parametrize("roll", [1, 0])
def test_a_thinned_kernel_is_the_thick_one_drawn_to_the_path(roll) -> None:
    path = PATH / 5 * [1, 1, roll]
    thick = smeared(path)
    thin = thinned(thick, 1.4)
    assert off(thin, path) < 0.65 * off(thick, path)
    assert len(thin.weights) < len(thick.weights)
    true = RotationKernel.from_path(path * STEPS, CAMERA)
    assert spread_px(thin) == pytest.approx(spread_px(true), rel=0.03)
    # The light and where the camera pointed are kept.
    assert thin.weights.sum() == pytest.approx(1)
    assert thin.weights.min() > 0
    np.testing.assert_allclose(thin.centroid, thick.centroid, atol=1e-9)
    np.testing.assert_array_equal(thin.steps, thick.steps)


def test_thinning_keeps_a_thin_path_and_a_point() -> None:
    path = RotationKernel.from_path(np.array([[0.0, -8, 0], [0, 8, 0]]) * STEPS, CAMERA)
    assert agreement(thinned(path), path, smoothing=0.1) > 0.99
    point = RotationKernel.delta(CAMERA)
    np.testing.assert_allclose(thinned(point).theta, 0, atol=1e-12)


def test_a_uniform_kernel_stays_uniform() -> None:
    camera = Camera.uniform(120, 160)
    steps = grid_steps(camera)
    disk = [[x, y, 0] for x in range(-2, 3) for y in range(-9, 10)]
    kernel = RotationKernel.from_indices(disk, np.ones(len(disk)), steps, camera)
    thin = thinned(kernel, 1.4)
    np.testing.assert_allclose(thin.theta[:, 2], 0, atol=1e-12)
    across = np.sqrt(thin.weights @ thin.theta[:, 0] ** 2) / steps[0]
    assert across < 0.6


@pytest.mark.parametrize("roll", [1, 0])
def test_a_smooth_path_is_nearer_to_the_truth_than_a_thick_kernel(roll) -> None:
    path = PATH / 5 * [1, 1, roll]
    thick = smeared(path)
    smooth = smooth_path(thick, CAMERA)
    true = RotationKernel.from_path(path * STEPS, CAMERA)
    assert off(smooth, path) < 0.65 * off(thick, path)
    assert agreement(smooth, true, smoothing=0.1) > agreement(thick, true, smoothing=0.1)
    assert agreement(smooth, true, smoothing=0.1) > 0.87
    assert smooth.weights.sum() == pytest.approx(1)
    assert smooth.weights.min() > 0


@pytest.mark.parametrize("roll", [1, 0])
def test_smooth_paths_are_much_nearer_to_the_truth_on_the_mean(roll) -> None:
    path = PATH / 5 * [1, 1, roll]
    thick = [smeared(path, seed) for seed in range(10)]
    ratios = [off(smooth_path(one, CAMERA), path) / off(one, path) for one in thick]
    assert np.mean(ratios) < 0.62


def test_a_smooth_path_closes_gaps_and_turns_back() -> None:
    """A hand turns round at one end; the estimate has a hole in its way back."""
    there = np.array([[0.0, -20, 0], [0, 20, 0], [8, 24, 0], [14, 18, 0], [15, -12, 0]])
    whole = RotationKernel.from_path(there * STEPS, CAMERA)
    x, y = whole.theta[:, 0] / STEPS[0], whole.theta[:, 1] / STEPS[1]
    kept = ~((x > 12) & (np.abs(y - 4) < 3))
    weights = whole.weights[kept] / whole.weights[kept].sum()
    torn = RotationKernel(whole.theta[kept], weights, STEPS, CAMERA).resampled(STEPS)
    smooth = smooth_path(torn, CAMERA)
    assert not hangs_together(torn, 3)
    assert hangs_together(smooth, 2)
    assert agreement(smooth, whole, smoothing=0.1) > 0.95


def test_a_smooth_path_rests_where_the_camera_rests() -> None:
    places = [[0, i, 0] for i in range(13)]
    kernel = RotationKernel.from_indices(places, [30] + [1] * 12, STEPS, CAMERA)
    smooth = smooth_path(kernel, CAMERA)
    near = np.abs(smooth.theta[:, 1] - kernel.theta[0, 1]) < 3 * STEPS[1]
    assert smooth.weights[near].sum() > 0.7


def test_the_smooth_path_of_a_kernel_without_roll_has_none() -> None:
    flat = RotationKernel.from_path(PATH * [1, 1, 0] * STEPS / 5, CAMERA).centred()
    assert 0 < np.ptp(flat.theta[:, 2]) < 0.1 * STEPS[2]
    np.testing.assert_allclose(smooth_path(flat, CAMERA).theta[:, 2], 0, atol=1e-12)


def test_the_smooth_path_of_a_point_is_the_point() -> None:
    point = RotationKernel.delta(CAMERA)
    assert SmoothPath.through(point, CAMERA) == []


def test_the_smooth_path_of_a_coarse_kernel_has_the_steps_of_the_photo() -> None:
    smooth = smooth_path(coarse(4.0), CAMERA.scaled(300, 400))
    np.testing.assert_allclose(smooth.steps, STEPS)
    assert hangs_together(smooth, 1.5)
    assert filled_path(smooth) is smooth
    assert off(smooth, PATH - np.average(PATH, axis=0)) < 25


def test_a_smooth_path_goes_along_a_side_branch_and_back() -> None:
    """A hand that turns aside and comes back leaves three branches, not one line."""
    aside = np.array([[0.0, -15, 0], [0, 0, 0], [12, 3, 0], [0, 0, 0], [-4, 15, 0]])
    kernel = RotationKernel.from_path(aside * STEPS, CAMERA).centred()
    smooth = smooth_path(kernel, CAMERA)
    assert agreement(smooth, kernel, smoothing=0.1) > 0.95
    assert off(kernel, (smooth.theta - smooth.centroid) / STEPS) < 1


def test_a_long_path_has_more_control_points() -> None:
    short, long = (
        SmoothPath.through(RotationKernel.from_path(PATH * scale * STEPS, CAMERA), CAMERA)[0]
        for scale in (0.05, 0.5)
    )
    assert len(short.controls) == 8
    assert len(short.controls) < len(long.controls) <= 30


def test_a_reflected_path_has_every_rotation_reversed() -> None:
    path = SmoothPath.through(RotationKernel.from_path(PATH * STEPS / 5, CAMERA), CAMERA)[0]
    kernel = path.kernel(CAMERA)
    turned = RotationKernel(-kernel.theta, kernel.weights, STEPS, CAMERA)
    assert agreement(path.reflected.kernel(CAMERA), turned, smoothing=0.1) > 0.99


def test_a_path_is_the_same_curve_on_another_scale() -> None:
    path = SmoothPath.through(RotationKernel.from_path(PATH * STEPS / 5, CAMERA), CAMERA)[0]
    half = CAMERA.scaled(CAMERA.height // 2, CAMERA.width // 2)
    on_half = path.on_scale(half)
    assert on_half.length == pytest.approx(path.length / 2, rel=0.03)
    np.testing.assert_allclose(
        on_half.controls * grid_steps(half), path.controls * STEPS, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("count", [12, 30])
def test_a_path_keeps_its_curve_with_other_control_points(count) -> None:
    path = SmoothPath.through(RotationKernel.from_path(PATH * STEPS / 5, CAMERA), CAMERA)[0]
    other = path.with_controls(count)
    assert other.controls.shape == (count, 3)
    assert other.camera is path.camera
    places, copied = (one.basis(200) @ one.controls for one in (path, other))
    assert np.abs(copied - places).max() < 0.05 * np.ptp(places, 0).max()
    assert path.with_controls(len(path.controls)) is path


CORNERS = np.array([[0.0, -20, 0], [0, 12, 4], [14, 12, 4], [14, -8, 0], [6, -8, 0], [6, 4, 0]])


@pytest.mark.parametrize("roll", [1, 0])
@pytest.mark.parametrize("even", [0.0, 0.5, 1.0])
def test_a_path_that_settles_is_much_nearer_to_its_kernel(even, roll) -> None:
    """Whatever course of time it begins with, it ends with that of the kernel."""
    slow = np.concatenate([CORNERS[:2], np.linspace(CORNERS[1], CORNERS[2], 12), CORNERS[3:]])
    kernel = RotationKernel.from_path(slow * [1, 1, roll] * STEPS, CAMERA).centred()
    path = SmoothPath.through(kernel, CAMERA, (even,))[0]
    settled = path.settled(kernel)
    before, after = (
        agreement(one.kernel(CAMERA), kernel, smoothing=0.1) for one in (path, settled)
    )
    assert after > 0.96
    assert 1 - after < 0.6 * (1 - before)
    assert settled.controls.shape == path.controls.shape


def test_a_path_without_roll_settles_without_roll() -> None:
    kernel = RotationKernel.from_path(CORNERS * STEPS, CAMERA).centred()
    flat = kernel.resampled(STEPS, (True, True, False))
    path = SmoothPath.through(flat, CAMERA)[0].settled(kernel)
    np.testing.assert_array_equal(path.controls[:, 2], 0)


@pytest.mark.parametrize("width", [1.5, 0.6])
def test_settling_lowers_the_difference_of_the_densities(width) -> None:
    """The objective, written out, falls; no small move of a control point lowers it further."""
    kernel = RotationKernel.from_path(CORNERS * [1, 1, 0] * STEPS, CAMERA).centred()
    path = SmoothPath.through(kernel, CAMERA, (0.5,))[0]
    places, basis = kernel.theta / STEPS, path.basis(80)
    grid = np.stack(np.meshgrid(*[np.arange(-24, 25.0)] * 2, indexing="ij"), -1).reshape(-1, 2)

    def density(points, weights) -> np.ndarray:
        squares = np.square(grid[:, None] - points[None, :, :2]).sum(2)
        return np.exp(-squares / (2 * width**2)) @ weights

    def difference(controls) -> float:
        curve = basis @ controls
        drawn = density(curve - curve.mean(0), np.full(80, 1 / 80))
        wanted = density(places - kernel.weights @ places, kernel.weights)
        bends = np.square(np.diff(controls, 2, axis=0)).sum()
        price = SETTINGS.camera_path.settled_stiffness / len(controls)
        return float(np.square(drawn - wanted).sum() / np.square(wanted).sum() + price * bends)

    end = _settled(path.controls, basis, places - kernel.weights @ places, kernel.weights, width)
    assert difference(end) < 0.5 * difference(path.controls)
    rng = np.random.default_rng(5)
    for _ in range(10):
        move = rng.normal(0, 0.3, end.shape) * [1, 1, 0]
        assert difference(end + move) > difference(end)
