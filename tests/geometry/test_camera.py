from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deshake.geometry.camera import UNIFORM_FOCAL_FACTOR, Camera
from deshake.geometry.rotations import displacements, homographies

RAYS = np.random.default_rng(0).normal(size=(20, 3)) * [0.3, 0.2, 0.0] + [0.0, 0.0, 1.0]


def shown_points(camera: Camera) -> np.ndarray:
    """Pixels (x, y) of some rays."""
    pixels = RAYS @ camera.matrix.T
    return pixels[:, :2] / pixels[:, 2:]


def test_principal_point_is_the_middle_of_the_pixel_centres() -> None:
    camera = Camera.from_focal(900.0, 30, 41)
    np.testing.assert_array_equal(camera.matrix, [[900, 0, 20], [0, 900, 14.5], [0, 0, 1]])
    assert camera.focal_px == pytest.approx(900)
    assert camera.shape == (30, 41)


def test_focal_px_is_the_geometric_mean() -> None:
    camera = Camera(np.array([[400.0, 0, 0], [0, 900, 0], [0, 0, 1]]), 10, 10)
    assert camera.focal_px == pytest.approx(600)


@given(st.integers(1, 300), st.integers(1, 300))
def test_scaled_keeps_where_rays_fall_in_the_frame(height: int, width: int) -> None:
    camera = Camera.from_focal(70.0, 48, 64)
    small = camera.scaled(height, width)
    assert small.shape == (height, width)
    # a pixel covers half a pixel around its centre: the frame's borders stay its borders
    part = (shown_points(camera) + 0.5) / [64, 48]
    np.testing.assert_allclose((shown_points(small) + 0.5) / [width, height], part, atol=1e-9)


@pytest.mark.parametrize(("height", "width"), [(24, 32), (16, 16), (96, 128)])
def test_scaled_agrees_with_resizing(height: int, width: int) -> None:
    camera = Camera.from_focal(70.0, 48, 64)
    y, x = np.mgrid[0:48, 0:64].astype(np.float32)
    ways = cv2.INTER_AREA if height < 48 else cv2.INTER_LINEAR
    x_there = cv2.resize(x, (width, height), interpolation=ways)
    y_there = cv2.resize(y, (width, height), interpolation=ways)
    # the place of each new pixel in the old picture
    back = camera.matrix @ np.linalg.inv(camera.scaled(height, width).matrix)
    column, row = width // 3, height // 3
    expected = back @ [column, row, 1]
    assert x_there[row, column] == pytest.approx(expected[0], abs=1e-4)
    assert y_there[row, column] == pytest.approx(expected[1], abs=1e-4)


def test_scaled_there_and_back() -> None:
    camera = Camera.from_focal(70.0, 48, 64)
    again = camera.scaled(31, 77).scaled(48, 64)
    np.testing.assert_allclose(again.matrix, camera.matrix, atol=1e-12)


def test_cropped_shifts_the_pixels() -> None:
    camera = Camera.from_focal(70.0, 48, 64)
    crop = camera.cropped(5, 7, 20, 10)
    assert crop.shape == (10, 20)
    np.testing.assert_allclose(shown_points(crop), shown_points(camera) - [5, 7], atol=1e-9)


def test_a_zoomed_camera_has_a_longer_focal_length_and_the_same_middle() -> None:
    camera = Camera.from_focal(70.0, 48, 64).cropped(3, 5, 40, 30)
    longer = camera.zoomed(1.5)
    assert longer.focal_px == pytest.approx(105)
    assert np.array_equal(longer.matrix[:, 2], camera.matrix[:, 2])
    assert longer.shape == camera.shape
    assert camera.zoomed(1.0) is camera


def test_padded_is_undone_by_cropping() -> None:
    camera = Camera.from_focal(70.0, 48, 64)
    padded = camera.padded(9)
    assert padded.shape == (66, 82)
    np.testing.assert_allclose(shown_points(padded), shown_points(camera) + 9, atol=1e-9)
    np.testing.assert_array_equal(padded.cropped(9, 9, 64, 48).matrix, camera.matrix)


def test_corners_are_pixel_centres() -> None:
    corners = Camera.from_focal(70.0, 48, 64).corners
    assert corners.shape == (9, 2)
    assert {tuple(p) for p in corners} >= {(0.0, 0.0), (63.0, 47.0), (31.5, 23.5), (63.0, 0.0)}


def test_uniform_camera_turns_rotations_into_translations() -> None:
    camera = Camera.uniform(60, 80)
    assert camera.is_uniform
    assert not Camera.from_focal(80.0, 60, 80).is_uniform
    assert camera.focal_px == UNIFORM_FOCAL_FACTOR * 80
    theta = np.array([[0.0, 30 / camera.focal_px, 0.0], [-20 / camera.focal_px, 0.0, 0.0]])
    moved = displacements(homographies(camera, theta), camera.corners)
    np.testing.assert_allclose(moved[:, 0], np.tile([30.0, 0.0], (9, 1)), atol=1e-3)
    np.testing.assert_allclose(moved[:, 1], np.tile([0.0, 20.0], (9, 1)), atol=1e-3)


def test_matrix_is_a_read_only_copy() -> None:
    matrix = np.array([[70.0, 0, 0], [0, 70, 0], [0, 0, 1]])
    camera = Camera(matrix, 10, 10)
    matrix[0, 0] = 1
    assert camera.matrix[0, 0] == 70
    with pytest.raises(ValueError, match=r"read-only"):
        camera.matrix[0, 0] = 1


@pytest.mark.parametrize(
    ("matrix", "height", "width"),
    [
        (np.eye(2), 10, 10),
        (np.full((3, 3), np.nan), 10, 10),
        (np.diag([-70.0, 70, 1]), 10, 10),
        (np.diag([0.0, 70, 1]), 10, 10),
        (np.diag([70.0, 70, 2]), 10, 10),
        (np.diag([70.0, 70, 1]), 0, 10),
        (np.diag([70.0, 70, 1]), 10, -1),
    ],
)
def test_wrong_cameras_are_refused(matrix: np.ndarray, height: int, width: int) -> None:
    with pytest.raises(ValueError, match=r"camera matrix|at least one pixel"):
        Camera(matrix, height, width)
