from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.blind.variational.coarse_to_fine import (
    PyramidPlan,
    first_kernel,
    latent_differences,
    next_kernel,
    resize,
    turn,
    turned_gradients,
)
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.operators.shake_blur import ShakeBlur

CAMERA = Camera.from_focal(400.0, 300, 400)
FLAT = (True, True, False)


@pytest.mark.parametrize("blur", [3, 10, 24, 60])
def test_scales_grow_by_the_root_of_two_up_to_the_camera(blur: int) -> None:
    levels = PyramidPlan(CAMERA, blur).levels()
    assert [level.index for level in levels] == list(range(len(levels)))[::-1]
    assert levels[-1].camera.shape == CAMERA.shape
    for level in levels:
        scale = 2 ** (-level.index / 2)
        assert level.camera.height == pytest.approx(300 * scale, abs=0.5)
        assert level.camera.width == pytest.approx(400 * scale, abs=0.5)
        np.testing.assert_allclose(level.steps, levels[-1].steps / scale)
    assert min(levels[0].camera.shape) >= 16


@pytest.mark.parametrize("blur", [3, 10, 24])
def test_the_box_holds_the_blur_at_every_scale(blur: int) -> None:
    levels = PyramidPlan(CAMERA, blur).levels()
    for level in levels:
        assert np.all(2 * level.half + 1 >= blur * 2 ** (-level.index / 2))
        assert np.all(level.half <= level.half[0])
    assert levels[0].half.max() <= 2
    assert levels[-1].half.max() == blur // 2 + 2


def test_a_small_photo_has_few_scales() -> None:
    levels = PyramidPlan(Camera.from_focal(60.0, 48, 60), 24).levels()
    assert min(levels[0].camera.shape) >= 16
    assert len(levels) == 4


def test_the_start_is_a_neutral_cube_in_its_box() -> None:
    level = PyramidPlan(CAMERA, 24).levels()[2]
    kernel = first_kernel(level)
    assert len(kernel.weights) == np.prod(2 * level.half + 1)
    used = kernel.weights > 0
    assert used.sum() == 27
    assert np.abs(kernel.indices[used]).max() == 1
    np.testing.assert_allclose(kernel.weights[used], 1 / 27)


def test_the_uniform_start_has_no_turn_about_the_axis() -> None:
    level = PyramidPlan(Camera.uniform(300, 400), 24, FLAT).levels()[0]
    kernel = first_kernel(level)
    assert np.all(kernel.theta[:, 2] == 0)
    assert (kernel.weights > 0).sum() == 9


def curve(steps: np.ndarray, camera: Camera) -> RotationKernel:
    """A bent line of rotations, off the origin."""
    t = np.arange(-3, 4)
    indices = np.stack([t + 2, t**2 // 3, -t + 1], 1)
    return RotationKernel.from_indices(indices, 1.0 + t % 3, steps, camera)


def test_the_next_scale_keeps_mass_and_centroid() -> None:
    coarse, fine = PyramidPlan(CAMERA, 24).levels()[-2:]
    kernel = curve(coarse.steps, coarse.camera)
    active, offset = next_kernel(kernel, fine, ALL_AXES, cut=0.0)
    assert active.weights.sum() == pytest.approx(1)
    moved = kernel.centroid + offset * coarse.steps
    # tents of the root of two, sampled, are even to an eighth of a step
    np.testing.assert_allclose(active.centroid, moved, atol=0.2 * fine.steps.min())
    assert np.all(np.abs(moved) <= coarse.steps / 2 + 1e-12)
    assert active.camera is fine.camera
    np.testing.assert_array_equal(active.steps, fine.steps)


def test_small_weights_are_lost_between_scales() -> None:
    coarse, fine = PyramidPlan(CAMERA, 24).levels()[-2:]
    indices = [(0, 0, 0), (1, 0, 0), (0, 9, 0)]
    kernel = RotationKernel.from_indices(indices, [1, 1, 0.04], coarse.steps, coarse.camera)
    active, _ = next_kernel(kernel, fine, ALL_AXES, cut=0.05)
    assert np.abs(active.indices[:, 1]).max() < 5
    kept, _ = next_kernel(kernel, fine, ALL_AXES, cut=0.03)
    assert np.abs(kept.indices[:, 1]).max() > 9


def test_the_active_region_has_room_on_every_side() -> None:
    coarse, fine = PyramidPlan(CAMERA, 24).levels()[-2:]
    active, _ = next_kernel(curve(coarse.steps, coarse.camera), fine, ALL_AXES, cut=0.05)
    there = set(map(tuple, active.indices.tolist()))
    for index in active.indices[active.weights > 0]:
        around = index + np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), -1).reshape(-1, 3)
        assert set(map(tuple, around.tolist())) <= there
    assert (active.weights == 0).any()


def test_the_active_region_stays_in_the_box() -> None:
    coarse, fine = PyramidPlan(CAMERA, 10).levels()[-2:]
    indices = [(0, -i, 0) for i in range(-6, 7)]
    kernel = RotationKernel.from_indices(indices, np.ones(13), coarse.steps, coarse.camera)
    active, _ = next_kernel(kernel, fine, ALL_AXES, cut=0.05)
    assert np.all(np.abs(active.indices) <= fine.half)
    assert active.weights.sum() == pytest.approx(1)


def test_uniform_kernels_stay_uniform() -> None:
    coarse, fine = PyramidPlan(Camera.uniform(300, 400), 24, FLAT).levels()[-2:]
    indices = [(0, 0, 0), (1, 2, 0), (3, 1, 0)]
    kernel = RotationKernel.from_indices(indices, [1, 2, 3], coarse.steps, coarse.camera)
    active, _ = next_kernel(kernel, fine, FLAT, cut=0.05)
    assert np.all(active.theta[:, 2] == 0)
    assert len(active.weights) > 9


@pytest.mark.parametrize("offset", [(0, 3, 0), (-2, 0, 0), (1, -2, 0), (0, 0, 3)])
def test_a_turned_picture_with_the_moved_kernel_gives_the_same_photo(
    sharp: np.ndarray, offset: tuple[int, int, int]
) -> None:
    camera = Camera.from_focal(260.0, *sharp.shape)
    kernel = RotationKernel.from_path(np.array([[-2, 1, 0], [2, -1, 1]]) * 4e-3, camera)
    moved = kernel.shifted(offset)
    smooth = cv2.GaussianBlur(sharp, (0, 0), 1.5)
    turned = turn(smooth[None], camera, -np.asarray(offset) * kernel.steps)[0]
    inner = (slice(16, -16), slice(16, -16))
    before = ShakeBlur(kernel, margin=0).forward(smooth)[inner]
    after = ShakeBlur(moved, margin=0).forward(turned)[inner]
    without = ShakeBlur(moved, margin=0).forward(smooth)[inner]
    assert np.abs(after - before).mean() < 0.1 * np.abs(without - before).mean()


def test_resizing_keeps_means_and_places(sharp: np.ndarray) -> None:
    small = resize(sharp[None], (50, 65))
    np.testing.assert_allclose(small[0], sharp.reshape(50, 4, 65, 4).mean((1, 3)), atol=1e-5)
    y, x = np.mgrid[0:40, 0:60].astype(np.float32)
    grown = resize(np.stack([x, y]), (80, 120))
    camera = Camera.from_focal(60.0, 40, 60)
    np.testing.assert_allclose(grown[0, 40, 10:-10], (np.arange(10, 110) + 0.5) / 2 - 0.5, 1e-5)
    assert camera.scaled(80, 120).matrix[0, 2] == (grown.shape[2] - 1) / 2


def differences(picture: np.ndarray) -> np.ndarray:
    out = np.zeros((2, *picture.shape), np.float32)
    out[0, :, :-1], out[1, :-1] = np.diff(picture, axis=1), np.diff(picture, axis=0)
    return out


def misfit(ours: np.ndarray, want: np.ndarray) -> float:
    """Error of gradients away from the border, as a share of the wanted ones."""
    inner = np.s_[:, 4:-4, 4:-4]
    return float(np.linalg.norm((ours - want)[inner]) / np.linalg.norm(want[inner]))


@pytest.mark.parametrize("index", [0, 2, 4])
def test_latent_gradients_become_differences_of_their_scale(index: int, sharp: np.ndarray) -> None:
    smooth = cv2.GaussianBlur(sharp, (0, 0), 6)
    level = PyramidPlan(Camera.from_focal(260.0, *sharp.shape), 24).levels()[-1 - index]
    f = resize(differences(smooth), level.camera.shape)
    want = differences(resize(smooth[None], level.camera.shape)[0])
    result = latent_differences(f, level, np.zeros(3))
    assert misfit(result, want) < 0.04
    where_they_were = f * 2 ** (index / 2)
    assert index == 0 or misfit(result, want) < 0.5 * misfit(where_they_were, want)


def test_gradients_turn_as_their_picture_does(sharp: np.ndarray) -> None:
    smooth = cv2.GaussianBlur(sharp, (0, 0), 2)
    camera = Camera.from_focal(260.0, *sharp.shape)
    theta = np.array([-0.003, 0.005, 0.004])
    want = differences(turn(smooth[None], camera, theta)[0])
    result = turned_gradients(differences(smooth), camera, theta)
    assert misfit(result, want) < 0.05
    assert misfit(differences(smooth), want) > 0.3
