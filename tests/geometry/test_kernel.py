from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import (
    angle_axis,
    displacements,
    grid_steps,
    homographies,
    rotation_matrices,
)

CAMERA = Camera.from_focal(320.0, 240, 320)
STEPS = grid_steps(CAMERA)


def wander(seed: int, size: float = 8.0, nodes: int = 9) -> np.ndarray:
    """A smooth random camera path (T, 3), a few grid steps wide."""
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(size=(nodes, 3)), 0)
    return path / np.abs(path).max() * size * STEPS


def brute_bins(path: np.ndarray, durations: np.ndarray, steps: np.ndarray) -> dict:
    """Trilinear bins of a path walked in very small steps, one point at a time."""
    bins: dict[tuple[int, ...], float] = {}
    pieces = 400
    for a, b, time in zip(path[:-1], path[1:], durations, strict=True):
        for i in range(pieces):
            at = (a + (i + 0.5) / pieces * (b - a)) / steps
            low = np.floor(at)
            for corner in itertools.product((0, 1), repeat=3):
                share = np.prod(np.where(corner, at - low, 1 - at + low))
                key = tuple((low + corner).astype(int))
                bins[key] = bins.get(key, 0) + share * time / pieces
    return {key: value / sum(durations) for key, value in bins.items()}


def as_bins(kernel: RotationKernel) -> dict:
    return {tuple(i): w for i, w in zip(kernel.indices.tolist(), kernel.weights, strict=True)}


def distance(a: dict, b: dict) -> float:
    """Total variation between two sets of bins."""
    return sum(abs(a.get(key, 0) - b.get(key, 0)) for key in {*a, *b}) / 2


def marginal_distance(a: RotationKernel, b: RotationKernel) -> float:
    """Largest earth mover's distance between the marginals, in steps of a."""
    worst = 0.0
    for axis in range(3):
        places = np.concatenate([a.theta[:, axis], b.theta[:, axis]])
        mass = np.concatenate([a.weights, -b.weights])
        order = np.argsort(places)
        gaps = np.diff(places[order]) / a.steps[axis]
        worst = max(worst, float(np.abs(np.cumsum(mass[order])[:-1]) @ gaps))
    return worst


def test_path_is_binned_as_by_brute_force() -> None:
    path = wander(0, nodes=6)
    durations = np.array([1.0, 2.0, 0.5, 0.0, 3.0])
    kernel = RotationKernel.from_path(path, CAMERA, durations=durations)
    np.testing.assert_array_equal(kernel.steps, STEPS)
    assert distance(as_bins(kernel), brute_bins(path, durations, STEPS)) < 0.01


@given(st.integers(0, 1000), st.floats(0.3, 3.0))
@settings(max_examples=20, deadline=None, derandomize=True)
def test_path_keeps_mass_and_mean(seed: int, scale: float) -> None:
    path = wander(seed)
    kernel = RotationKernel.from_path(path, CAMERA, steps=STEPS * scale)
    middle = (path[:-1] + path[1:]).mean(0) / 2
    assert kernel.weights.sum() == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(kernel.centroid / STEPS, middle / STEPS, atol=1e-9)
    on_grid = kernel.theta / kernel.steps
    np.testing.assert_allclose(on_grid, np.rint(on_grid), atol=1e-9)
    assert len(np.unique(kernel.indices, axis=0)) == len(kernel.weights)


def test_a_path_that_stays_is_one_rotation() -> None:
    still = RotationKernel.from_path(3 * STEPS[None], CAMERA)
    assert as_bins(still) == {(3, 3, 3): pytest.approx(1)}


def test_a_long_stay_weighs_more() -> None:
    path = np.array([[0, 0, 0], [0, 0, 0], [0, 10, 0]]) * STEPS
    kernel = RotationKernel.from_path(path, CAMERA, durations=[9, 1])
    assert as_bins(kernel)[0, 0, 0] == pytest.approx(0.9 + 0.1 * 0.05, abs=1e-3)


def test_delta_stands_still() -> None:
    delta = RotationKernel.delta(CAMERA)
    assert as_bins(delta) == {(0, 0, 0): 1.0}
    assert delta.extent_px() == 0
    np.testing.assert_array_equal(delta.steps, STEPS)
    assert delta.is_still


def test_a_camera_that_turns_for_no_time_stands_still() -> None:
    theta = np.array([[0, 0, 0], [0, 0, 2]]) * STEPS
    assert RotationKernel(theta, np.array([1.0, 0.0]), STEPS, CAMERA).is_still
    assert not RotationKernel(theta, np.array([0.9, 0.1]), STEPS, CAMERA).is_still


def test_equal_indices_are_added_up() -> None:
    kernel = RotationKernel.from_indices(
        [[0, 1, 0], [2, 0, 0], [0, 1, 0]], [1, 2, 1], STEPS, CAMERA
    )
    assert as_bins(kernel) == {(0, 1, 0): 0.5, (2, 0, 0): 0.5}


@pytest.mark.parametrize("ratio", [2**0.5, 2.0, 2**-0.5, 0.5, 1.0])
def test_resampling_keeps_mass_and_mean(ratio: float) -> None:
    kernel = RotationKernel.from_path(wander(1), CAMERA)
    other = kernel.resampled(kernel.steps * ratio)
    assert other.weights.sum() == pytest.approx(1, abs=1e-12)
    np.testing.assert_array_equal(other.steps, kernel.steps * ratio)
    np.testing.assert_allclose(other.centroid / STEPS, kernel.centroid / STEPS, atol=0.05)


def test_resampling_to_the_same_grid_changes_nothing() -> None:
    kernel = RotationKernel.from_path(wander(1), CAMERA)
    assert distance(as_bins(kernel), as_bins(kernel.resampled(kernel.steps))) < 1e-9


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("ratio", [2**0.5, 2.0])
def test_resampled_path_stays_close_to_the_path_on_that_grid(seed: int, ratio: float) -> None:
    fine = RotationKernel.from_path(wander(seed), CAMERA)
    coarse = RotationKernel.from_path(wander(seed), CAMERA, steps=STEPS * ratio)
    assert marginal_distance(coarse, fine.resampled(STEPS * ratio)) < 0.3
    assert marginal_distance(fine, coarse.resampled(STEPS)) < 0.6 * ratio


def test_going_finer_spreads_a_tent() -> None:
    one = RotationKernel.from_indices([[0, 3, 0]], [1], STEPS, CAMERA)
    finer = one.resampled(STEPS / 2)
    weights = as_bins(finer)
    line = np.array([weights.get((0, i, 0), 0) for i in range(3, 10)])
    np.testing.assert_allclose(line / line.max(), [0, 0, 0.5, 1, 0.5, 0, 0], atol=1e-9)
    assert len(weights) == 27


def test_axes_left_out_stay_at_zero() -> None:
    kernel = RotationKernel.from_path(wander(2), CAMERA)
    for ratio in (0.7, 1.5):
        flat = kernel.resampled(STEPS * ratio, axes=(True, True, False))
        assert np.all(flat.indices[:, 2] == 0)
        assert np.ptp(flat.indices[:, 0]) > 2
    only = RotationKernel.delta(CAMERA).dilated(axes=(False, True, False))
    assert {tuple(i) for i in only.indices} == {(0, -1, 0), (0, 0, 0), (0, 1, 0)}


def test_dilation_adds_all_neighbours_at_no_weight() -> None:
    kernel = RotationKernel.from_indices([[0, 0, 0], [5, 0, 0]], [1, 3], STEPS, CAMERA)
    wide = kernel.dilated()
    assert len(wide.weights) == 54
    kept = {key: w for key, w in as_bins(wide).items() if w > 0}
    assert kept == as_bins(kernel)
    assert len(kernel.dilated().dilated().weights) == 5**3 + 5**3


def test_a_turned_kernel_has_turned_displacements() -> None:
    camera = Camera.from_focal(2000.0, 300, 400)
    path = np.array([[0.0, -9, 0], [2, 0, 0], [0, 9, 0]]) * grid_steps(camera)
    kernel = RotationKernel.from_path(path, camera).centred()
    middle = camera.matrix[:2, 2][None]
    moved, turned = (
        displacements(homographies(camera, one.theta), middle)[:, 0]
        for one in (kernel, kernel.turned(90))
    )
    down = np.stack([-moved[:, 1], moved[:, 0]], -1)  # clockwise, y points down
    np.testing.assert_allclose(turned, down, atol=0.02)
    np.testing.assert_allclose(kernel.turned(30).turned(-30).theta, kernel.theta, atol=1e-12)
    np.testing.assert_allclose(kernel.turned(47).centroid, kernel.centroid, atol=1e-12)
    np.testing.assert_array_equal(kernel.turned(47).weights, kernel.weights)


def test_centred_kernel_has_its_mean_at_the_origin() -> None:
    path = wander(3) + 30 * STEPS
    kernel = RotationKernel.from_path(path, CAMERA)
    centred = kernel.centred()
    np.testing.assert_allclose(centred.centroid, 0, atol=1e-12)
    np.testing.assert_array_equal(centred.weights, kernel.weights)


def test_uniform_kernels_are_centred_by_whole_steps() -> None:
    camera = Camera.uniform(60, 80)
    indices = np.array([[0, 0, 0], [5, 2, 0], [9, 2, 0]])
    kernel = RotationKernel.from_indices(indices, [1, 2, 3], grid_steps(camera), camera)
    centred = kernel.centred()
    assert np.abs(centred.centroid / kernel.steps).max() <= 0.5
    np.testing.assert_allclose(centred.theta / kernel.steps, indices - [6, 2, 0], atol=1e-9)


def test_centred_kernel_gives_the_same_photo_of_the_turned_scene() -> None:
    """No warp is involved: the scenes are functions."""
    offset = np.array([0.05, -0.04, 0.2])
    kernel = RotationKernel.from_path(wander(4) + offset, CAMERA)
    centred = kernel.centred()
    turn = rotation_matrices(kernel.theta[0]) @ rotation_matrices(centred.theta[0]).T
    back = homographies(CAMERA, angle_axis(turn)[None])

    def scene(points: np.ndarray) -> np.ndarray:
        return np.sin(points[..., 0] / 9) + np.cos(points[..., 1] / 7 + points[..., 0] / 30)

    def turned(points: np.ndarray) -> np.ndarray:
        flat = points.reshape(-1, 2)
        return scene(flat + displacements(back, flat)[:, 0]).reshape(points.shape[:-1])

    points = CAMERA.corners
    photo = scene(points[:, None] + kernel.displacements(points)) @ kernel.weights
    again = turned(points[:, None] + centred.displacements(points)) @ centred.weights
    np.testing.assert_allclose(again, photo, atol=1e-9)


def test_a_kernel_at_another_size_moves_the_same_parts_of_the_frame() -> None:
    kernel = RotationKernel.from_path(wander(5), CAMERA)
    double = kernel.at_size(480, 640)
    assert double.camera.shape == (480, 640)
    here = kernel.displacements([[10.0, 20.0], [300.0, 200.0]])
    there = double.displacements([[20.5, 40.5], [600.5, 400.5]])
    np.testing.assert_allclose(there, 2 * here, atol=1e-9)
    assert double.extent_px() == pytest.approx(2 * kernel.extent_px(), rel=0.01)


def test_a_kernel_of_a_crop_moves_the_same_pixels() -> None:
    kernel = RotationKernel.from_path(wander(5), CAMERA)
    crop = kernel.for_camera(CAMERA.cropped(40, 30, 100, 80))
    points = np.array([[50.0, 60.0], [90.0, 70.0]])
    np.testing.assert_allclose(
        crop.displacements(points - [40, 30]), kernel.displacements(points), atol=1e-9
    )


def test_a_kernel_for_a_longer_lens_moves_the_middle_alike_and_the_corners_less() -> None:
    kernel = RotationKernel.from_path(wander(5) * [1, 1, 0], CAMERA)
    longer = kernel.zoomed(2.0)
    assert longer.camera.focal_px == pytest.approx(2 * CAMERA.focal_px)
    middle = CAMERA.matrix[:2, 2]
    here, there = kernel.displacements([middle]), longer.displacements([middle])
    np.testing.assert_allclose(there, here, atol=0.01 * np.abs(here).max())
    corner = np.abs(kernel.displacements([[0.0, 0.0]])).max()
    assert np.abs(longer.displacements([[0.0, 0.0]])).max() < 0.95 * corner
    np.testing.assert_array_equal(longer.indices, kernel.indices)


def test_a_roll_is_the_same_for_every_lens() -> None:
    roll = RotationKernel.from_path(wander(5) * [0, 0, 1], CAMERA)
    points = np.array([[0.0, 0.0], [30.0, 20.0]])
    np.testing.assert_allclose(
        roll.zoomed(2.0).displacements(points), roll.displacements(points), atol=1e-9
    )


def test_extent_is_the_widest_spread() -> None:
    indices = [[0, -10, 0], [0, 15, 0], [0, 400, 0]]
    kernel = RotationKernel.from_indices(indices, [1, 1, 1e-3], STEPS, CAMERA)
    assert kernel.extent_px() == pytest.approx(25, abs=0.5)
    assert len(kernel.above(0.01).weights) == 2
    assert kernel.above(0.01).weights.sum() == pytest.approx(1)


@pytest.mark.parametrize(("index", "along"), [([0, 25, 0], 0), ([25, 0, 0], 1)])
def test_the_extents_are_those_along_x_and_y(index, along) -> None:
    kernel = RotationKernel.from_indices([[0, 0, 0], index], [1, 1], STEPS, CAMERA)
    extents = kernel.extents_px()
    assert extents[along] == kernel.extent_px() == pytest.approx(25, rel=0.1)
    assert extents[1 - along] < 5  # of the perspective at the corners


def test_shifted_moves_by_whole_steps() -> None:
    kernel = RotationKernel.from_indices([[0, 1, 0], [2, 0, 0]], [1, 1], STEPS, CAMERA)
    assert set(as_bins(kernel.shifted([1, -2, 3]))) == {(1, -1, 3), (3, -2, 3)}


def test_arrays_are_read_only() -> None:
    kernel = RotationKernel.delta(CAMERA)
    for name in ("theta", "weights", "steps"):
        with pytest.raises(ValueError, match=r"read-only"):
            getattr(kernel, name)[:] = 0


@pytest.mark.parametrize(
    "changed",
    [
        {"theta": np.zeros((2, 2))},
        {"theta": np.zeros(3)},
        {"theta": np.full((2, 3), np.nan)},
        {"theta": np.zeros((0, 3)), "weights": np.zeros(0)},
        {"weights": np.ones(3) / 3},
        {"weights": [0.5, np.inf]},
        {"weights": [1.5, -0.5]},
        {"weights": [0.5, 0.4]},
        {"steps": [1e-3, 1e-3]},
        {"steps": [1e-3, 0.0, 1e-3]},
        {"steps": [1e-3, np.nan, 1e-3]},
    ],
)
def test_wrong_kernels_are_refused(changed: dict) -> None:
    right = {"theta": np.zeros((2, 3)), "weights": [0.5, 0.5], "steps": STEPS, "camera": CAMERA}
    RotationKernel(**right)
    with pytest.raises(ValueError, match=r"kernel|rotations"):
        RotationKernel(**{**right, **changed})


@pytest.mark.parametrize(
    ("path", "durations"),
    [
        (np.zeros((0, 3)), None),
        (np.zeros((4, 2)), None),
        (np.full((4, 3), np.inf), None),
        (np.zeros((4, 3)), [1, 1]),
        (np.zeros((4, 3)), [1, -1, 1]),
        (np.zeros((4, 3)), [0, 0, 0]),
    ],
)
def test_wrong_paths_are_refused(path: np.ndarray, durations: list | None) -> None:
    with pytest.raises(ValueError, match=r"camera path|durations"):
        RotationKernel.from_path(path, CAMERA, durations=durations)


def test_a_rotation_far_off_the_grid_is_refused() -> None:
    with pytest.raises(ValueError, match="grid steps"):
        RotationKernel.from_indices([[1 << 20, 0, 0]], [1], STEPS, CAMERA)


def test_the_reach_bounds_the_displacements_of_rotations_with_a_weight() -> None:
    camera = Camera.from_focal(400.0, 120, 160)
    theta = np.array([[0, 0, 0], [0, 0.02, 0], [0, 0.3, 0]])
    kernel = RotationKernel(theta, np.array([0.5, 0.5, 0.0]), np.full(3, 0.01), camera)
    farthest = np.abs(kernel.displacements(camera.corners)[:, :2]).max()
    assert farthest < kernel.reach_px() <= farthest + 2
