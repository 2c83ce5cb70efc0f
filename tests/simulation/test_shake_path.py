from __future__ import annotations

import numpy as np
import pytest

from deshake.errors import DeshakeError
from deshake.geometry.camera import Camera
from deshake.simulation.shake_path import CameraPath, random_path, read_path

CAMERA = Camera.from_focal(700, 480, 640)


@pytest.mark.parametrize("blur_px", [3, 10, 30])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_random_paths_have_the_extent_asked_for(blur_px, seed):
    path = random_path(CAMERA, blur_px, seed=seed)
    assert path.extent_px(CAMERA) == pytest.approx(blur_px, rel=1e-3)
    assert path.kernel(CAMERA).extent_px() == pytest.approx(blur_px, abs=3)


def test_the_seed_decides_a_random_path():
    one, same, other = (random_path(CAMERA, 10, seed=s).theta for s in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1e-3


def test_random_paths_turn_smoothly_about_all_axes():
    spread = np.array([np.ptp(random_path(CAMERA, 20, seed=s).theta, 0) for s in range(40)])
    middle = np.median(spread, 0)
    assert middle.max() < 2 * middle.min()
    theta = random_path(CAMERA, 20, seed=3).theta
    power = np.abs(
        np.fft.rfft(np.diff(theta, axis=0) * np.hanning(len(theta) - 1)[:, None], axis=0)
    )
    assert (power[:12] ** 2).sum() > 0.99 * (power**2).sum()  # below 24 Hz in half a second


@pytest.mark.parametrize("blur_px", [0, -1, float("nan")])
def test_random_paths_need_an_extent(blur_px):
    with pytest.raises(ValueError, match="extent"):
        random_path(CAMERA, blur_px)


def test_random_paths_stay_in_the_frame():
    with pytest.raises(DeshakeError, match="half of the frame"):
        random_path(CAMERA, 321)


def test_centring_takes_the_centroid_to_the_origin():
    away = np.array((0.1, -0.2, 0.3))
    path = CameraPath(random_path(CAMERA, 20, seed=5).theta + away)
    centred = path.centred(CAMERA)
    assert np.abs(centred.kernel(CAMERA).centroid).max() < 1e-9
    assert centred.extent_px(CAMERA) == pytest.approx(20, rel=0.05)


def test_pieces_are_fine_and_weigh_by_time():
    theta = np.array([(0, 0, 0), (0, 0.01, 0), (0, 0.01, 0), (0, 0.02, 0)])
    path = CameraPath(theta, np.array([1.0, 2.0, 1.0]))
    middles, weights = path.pieces(CAMERA)
    assert weights.sum() == pytest.approx(1)
    assert weights.min() > 0
    moved = np.abs(np.diff(middles[:, 1])) * CAMERA.focal_px
    assert moved.max() < 0.5
    still = np.abs(middles[:, 1] - 0.01) * CAMERA.focal_px < 0.5
    assert weights[still].sum() == pytest.approx(0.5, abs=0.1)  # the camera stood half the time
    assert weights @ middles == pytest.approx(path.kernel(CAMERA).centroid, abs=2e-4)


@pytest.mark.parametrize(
    ("turns", "times", "end"),
    [((0, 0, 0.005, 0.01), (2.0, 1, 1), 0), ((0, 0.005, 0.01, 0.01), (1.0, 1, 2), -1)],
)
def test_time_at_rest_at_an_end_counts(turns, times, end):
    theta = np.zeros((4, 3))
    theta[:, 0] = turns
    middles, weights = CameraPath(theta, np.array(times)).pieces(CAMERA)
    assert weights[end] > 0.5
    assert weights.sum() == pytest.approx(1)
    assert len(middles) == len(weights)


@pytest.mark.parametrize("theta", [np.zeros((1, 3)), np.zeros((5, 3))])
def test_a_camera_at_rest_is_one_piece(theta):
    middles, weights = CameraPath(theta).pieces(CAMERA)
    np.testing.assert_array_equal(middles, np.zeros((1, 3)))
    np.testing.assert_array_equal(weights, [1])
    assert len(CameraPath(theta).centred(CAMERA).kernel(CAMERA).weights) == 1


@pytest.mark.parametrize(
    ("theta", "durations"),
    [
        (np.zeros((0, 3)), None),
        (np.zeros((4, 2)), None),
        (np.full((2, 3), np.nan), None),
        (np.zeros((3, 3)), np.ones(3)),
        (np.zeros((3, 3)), np.array([1, -1])),
        (np.zeros((3, 3)), np.zeros(2)),
    ],
)
def test_paths_are_checked(theta, durations):
    with pytest.raises(ValueError, match=r"path|durations"):
        CameraPath(theta, durations)


def test_paths_too_wide_or_too_long_are_refused():
    wide = CameraPath(np.deg2rad([(0, 0, 0), (0, 60, 0)]))
    with pytest.raises(DeshakeError, match="20 degrees"):
        wide.centred(CAMERA)
    back_and_forth = np.zeros((4000, 3))
    back_and_forth[::2, 1] = 0.02
    with pytest.raises(DeshakeError, match="pixels long"):
        CameraPath(back_and_forth).centred(CAMERA)


@pytest.mark.parametrize("separator", [",", ", ", "\t", ";", "  "])
def test_reads_angles_in_degrees(tmp_path, separator):
    file = tmp_path / "path.csv"
    rows = [(0, 0, 0), (0.5, -1, 2e-1)]
    file.write_text(
        "# a comment\n\nrx,ry,rz\n" + "\n".join(separator.join(map(str, row)) for row in rows)
    )
    path = read_path(file)
    np.testing.assert_allclose(path.theta, np.deg2rad(rows))
    np.testing.assert_allclose(path.durations, [1])


def test_reads_times_in_the_first_of_four_columns(tmp_path):
    file = tmp_path / "path.txt"
    file.write_text("\ufefft rx ry rz\n10.0 0 0 0\n10.5 0 1 0\n10.6 0 1 1\n", "utf-8")
    path = read_path(file)
    np.testing.assert_allclose(path.durations, [0.5, 0.1])
    np.testing.assert_allclose(path.theta, np.deg2rad([(0, 0, 0), (0, 1, 0), (0, 1, 1)]))


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "no rows"),
        (b"rx,ry,rz\n", "no rows"),
        (b"1,2\n", "line 1 has 2 numbers"),
        (b"1,2,3\n1,2,3,4\n", "line 2 has 4"),
        (b"1,2,3\n1,two,3\n", "line 2 is not"),
        (b"x,y,z\nu,v,w\n1,2,3\n", "line 2 is not"),
        (b"1,2,nan\n", "degrees"),
        (b"1,2,91\n", "degrees"),
        (b"1,0,0,0\n0,1,1,1\n", "times"),
        (b"\x93NUMPY\xff\xfe", "not a text file"),
    ],
)
def test_bad_files_are_reported_in_a_line(tmp_path, content, what):
    file = tmp_path / "path.csv"
    file.write_bytes(content)
    with pytest.raises(DeshakeError, match=what) as caught:
        read_path(file)
    assert caught.value.file == str(file)


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(DeshakeError, match="no such file"):
        read_path(tmp_path / "none.csv")
