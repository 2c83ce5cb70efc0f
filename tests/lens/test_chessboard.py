from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.errors import EstimationError
from deshake.geometry.distortion import undistorted
from deshake.lens.chessboard import board_camera, find_board


@pytest.fixture(scope="module")
def corner_lists(boards):
    photos, board, _ = boards
    return [find_board(photo, board) for photo in photos]


def test_corners_are_detected_where_they_are(boards, corner_lists):
    _, board, camera = boards
    # the first pose of the fixtures, projected by OpenCV
    places = np.zeros((board[0] * board[1], 3))
    places[:, :2] = np.mgrid[0 : board[0], 0 : board[1]].T.reshape(-1, 2)
    pose = np.array((0.5, 0.1, 0.0)), np.array((-3.2, -2.4, 9.5))
    true = cv2.projectPoints(places, *pose, camera.matrix, camera.distortion)[0].reshape(-1, 2)
    gaps = np.linalg.norm(corner_lists[0][:, None] - true, axis=-1)
    assert gaps.min(1).max() < 0.5  # OpenCV may begin at another corner
    assert len(set(gaps.argmin(1).tolist())) == len(true)


def test_large_photos_are_searched_small_and_refined(boards):
    photos, board, _ = boards
    large = cv2.resize(photos[0], None, fx=6, fy=6, interpolation=cv2.INTER_CUBIC)
    small, fine = find_board(photos[0], board), find_board(large, board)
    np.testing.assert_allclose((fine + 0.5) / 6 - 0.5, small, atol=0.7)


def test_the_camera_is_estimated(boards, corner_lists):
    _, board, camera = boards
    result = board_camera(corner_lists, board, *camera.shape)
    assert result.camera.focal_px == pytest.approx(camera.focal_px, rel=0.01)
    np.testing.assert_allclose(result.camera.matrix[:2, 2], camera.matrix[:2, 2], atol=3)
    assert result.error_px < 0.3
    assert len(result.errors_px) == len(corner_lists)
    assert 0 < result.focal_sigma_px < 0.02 * camera.focal_px
    assert result.reach == pytest.approx(0.59, abs=0.02)
    # both cameras straighten alike, where the boards reach
    y, x = np.mgrid[40:260:20, 50:350:25].reshape(2, -1)
    points = np.stack([x, y], 1).astype(float)
    rays = [
        (undistorted(points, each, each) - each.matrix[:2, 2]) / each.focal_px
        for each in (result.camera, camera)
    ]
    apart = (rays[0] - rays[1]) * camera.focal_px
    assert np.abs(apart - apart.mean(0)).max() < 1.5


def test_a_photo_without_a_board_has_none(boards):
    _, board, _ = boards
    assert find_board(np.full((200, 300), 128, np.uint8), board) is None


def test_too_few_photos_are_refused(boards, corner_lists):
    _, board, camera = boards
    with pytest.raises(EstimationError, match="2 photos of a board are too few"):
        board_camera(corner_lists[:2], board, *camera.shape)


def test_boards_without_tilt_are_refused(boards):
    _, board, camera = boards
    places = np.mgrid[0 : board[0], 0 : board[1]].T.reshape(-1, 2)
    rng = np.random.default_rng(0)
    flat = [places * 30.0 + (60 + 10 * k, 50) + rng.normal(0, 0.1, places.shape) for k in range(4)]
    with pytest.raises(EstimationError, match=r"too much alike|do not fit one camera"):
        board_camera(flat, board, *camera.shape)


def test_corners_of_several_boards_are_refused(boards, corner_lists):
    _, board, camera = boards
    rng = np.random.default_rng(1)
    wrong = [corners + rng.normal(0, 15, corners.shape) for corners in corner_lists]
    with pytest.raises(EstimationError, match=r"do not fit one camera|too much alike") as caught:
        board_camera(wrong, board, *camera.shape)
    assert caught.value.hint
