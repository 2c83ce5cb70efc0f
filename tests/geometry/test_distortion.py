from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.distortion import distorted, fit_distortion, pinhole, undistorted

CAMERA = Camera.from_focal(450.0, 400, 600)
BARREL = np.array([-0.2, 0.05, 0, 0, -0.01, 0, 0, 0])
CUSHION = np.array([0.1, -0.02, 0, 0, 0])
SKEWED = np.array([-0.1, 0.02, 0.002, -0.001])
LENSES = [BARREL, CUSHION, SKEWED]


@pytest.mark.parametrize("lens", LENSES)
def test_undistorting_undoes_distorting(lens: np.ndarray) -> None:
    straight_camera = pinhole(CAMERA.with_lens(lens))
    points = np.random.default_rng(0).random((500, 2)) * (599, 399)
    there = distorted(points, CAMERA.with_lens(lens), straight_camera)
    assert np.abs(there - points).max() > 2
    np.testing.assert_allclose(
        undistorted(there, CAMERA.with_lens(lens), straight_camera), points, atol=1e-6
    )


def test_the_model_is_opencvs_written_out() -> None:
    there = distorted(np.array([[500.0, 300.0]]), CAMERA.with_lens(BARREL), CAMERA)
    x, y = (500 - 299.5) / 450, (300 - 199.5) / 450
    r2 = x * x + y * y
    q = 1 - 0.2 * r2 + 0.05 * r2**2 - 0.01 * r2**3
    np.testing.assert_allclose(there, [[x * q * 450 + 299.5, y * q * 450 + 199.5]], atol=1e-9)


@pytest.mark.parametrize("lens", LENSES)
def test_the_pinhole_sees_nothing_beyond_the_photo_and_touches_its_border(lens: np.ndarray) -> None:
    straight_camera = pinhole(CAMERA.with_lens(lens))
    y, x = np.mgrid[0:400, 0:600].reshape(2, -1)
    there = distorted(np.stack([x, y], 1), CAMERA.with_lens(lens), straight_camera)
    assert straight_camera.shape == CAMERA.shape
    assert there.min() > -2e-3
    assert (there <= np.array([599, 399]) + 2e-3).all()
    gap = np.concatenate([there.min(0), np.array([599, 399]) - there.max(0)])
    assert gap.min() < 0.01
    np.testing.assert_array_equal(straight_camera.matrix[:2, 2], CAMERA.matrix[:2, 2])


@pytest.mark.parametrize("lens", LENSES)
def test_the_whole_pinhole_sees_all_of_the_photo_and_no_smaller(lens: np.ndarray) -> None:
    straight_camera = pinhole(CAMERA.with_lens(lens), whole=True)
    y, x = np.mgrid[0:400, 0:600].reshape(2, -1)
    there = undistorted(np.stack([x, y], 1).astype(float), CAMERA.with_lens(lens), straight_camera)
    assert there.min() >= 0
    assert (there <= np.array([straight_camera.width - 1, straight_camera.height - 1])).all()
    assert straight_camera.width >= 600
    assert straight_camera.height >= 400


def test_no_distortion_leaves_the_camera() -> None:
    np.testing.assert_allclose(
        pinhole(CAMERA.with_lens(np.zeros(5))).matrix, CAMERA.matrix, atol=1e-3
    )


@pytest.mark.parametrize("lens", [np.array([-3.0, 0, 0, 0]), np.array([-1.2, 0, 0, 0])])
def test_the_middle_of_a_picture_that_folds_is_shown(lens: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"folds|too strong"):
        pinhole(CAMERA.with_lens(lens), whole=True)
    straight_camera = pinhole(CAMERA.with_lens(lens))  # a longer lens: what folds lies outside
    points = np.array([[0.0, 0], [599, 399], [300, 0]])
    there = distorted(points, CAMERA.with_lens(lens), straight_camera)
    np.testing.assert_allclose(
        undistorted(there, CAMERA.with_lens(lens), straight_camera), points, atol=0.1
    )


def test_the_uniform_camera_bends_alike() -> None:
    camera = CAMERA.with_lens(np.array([-0.1, 0.02, 0.002, -0.001, 0.01, 0.05, 0.01, 0.001]))
    whole = camera.as_uniform()
    points = np.random.default_rng(1).random((100, 2)) * (599, 399)
    ours = distorted(points, camera, camera)
    theirs = distorted(points, whole, whole)
    np.testing.assert_allclose(theirs, ours, atol=1e-6)
    assert whole.is_uniform


def test_a_curve_of_the_model_is_fitted() -> None:
    r = np.linspace(0.02, 0.9, 50)
    lens = np.array([-0.2, 0.05, 0, 0, -0.01, 0.03, 0.01, 0.02])
    above = 1 + lens[0] * r**2 + lens[1] * r**4 + lens[4] * r**6
    below = 1 + lens[5] * r**2 + lens[6] * r**4 + lens[7] * r**6
    coefficients, error = fit_distortion(r / 1.1, r * above / below)
    assert error < 1e-6
    bent_points = cv2.projectPoints(
        np.stack([r, 0 * r, 1 + 0 * r], 1), np.zeros(3), np.zeros(3), np.eye(3), coefficients
    )[0]
    np.testing.assert_allclose(bent_points[:, 0, 0], r * above / below, atol=1e-5)


def test_a_curve_of_odd_powers_is_fitted() -> None:
    """PTLens has odd powers: r (a r^3 + b r^2 + c r + 1 - a - b - c)."""
    r = np.linspace(0.03, 1.8, 60)
    bent = r * (0.01 * r**3 - 0.03 * r**2 + 0.005 * r + 1.015)
    _, error = fit_distortion(r, bent)
    assert error < 5e-5  # a tenth of a pixel, where half of the shorter side has 2000


def test_a_curve_that_turns_back_is_refused() -> None:
    with pytest.raises(ValueError, match="folds"):
        fit_distortion(np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.2, 0.19]))


@pytest.mark.parametrize("lens", [[-0.9, 0, 0, 0], [1e300, 0, 0, 0], [0, 0, 50, 50]])
def test_no_picture_grows_beyond_twice_its_area(lens: list[float]) -> None:
    with pytest.raises(ValueError, match=r"folds|too strong"):
        pinhole(CAMERA.with_lens(np.array(lens)), whole=True)
