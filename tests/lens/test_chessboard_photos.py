from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from deshake.errors import EstimationError, OutputError, PhotoError
from deshake.files.kernel_file import read_camera
from deshake.lens.chessboard_photos import calibrate_from_chessboards
from deshake.run import Run


@pytest.fixture
def files(boards, tmp_path):
    paths = []
    for number, photo in enumerate(boards[0]):
        paths.append(tmp_path / f"board{number}.png")
        Image.fromarray(photo).save(paths[-1])
    return paths


def test_the_camera_file_has_the_camera_of_the_boards(boards, files, tmp_path):
    _, board, camera = boards
    reports = []
    result = calibrate_from_chessboards(
        files,
        tmp_path / "c.npz",
        board,
        run=Run(progress=lambda share, text: reports.append((share, text))),
    )
    kept = read_camera(tmp_path / "c.npz")
    assert kept.camera.focal_px == pytest.approx(camera.focal_px, rel=0.01)
    assert kept.camera.shape == camera.shape
    assert np.array_equal(kept.camera.distortion, result.fit.camera.distortion)
    assert kept.source.startswith("chessboard of 7x5 corners, 6 photos, error 0.")
    report = result.report()
    assert report["inputs"] == [str(path) for path in files]
    assert len(report["errors_px"]) == 6
    [note] = report["notes"]
    assert "the distortion there is a guess" in note
    assert reports[0] == (0, "looking for the board in board0.png")


def test_photos_without_the_board_are_named(boards, files, tmp_path):
    blank = tmp_path / "blank.png"
    Image.new("L", (400, 300), 200).save(blank)
    with pytest.raises(EstimationError, match=r"7x5 inner corners is seen in .*blank\.png$"):
        calibrate_from_chessboards([*files, blank], tmp_path / "c.npz", boards[1])
    assert not (tmp_path / "c.npz").exists()


def test_photos_of_another_size_are_named(boards, files, tmp_path):
    other = tmp_path / "other.png"
    Image.fromarray(boards[0][0]).rotate(90, expand=True).save(other)
    with pytest.raises(
        PhotoError, match=r"it has 300 x 400 pixels, and .* has 400 x 300"
    ) as caught:
        calibrate_from_chessboards([*files, other], None, boards[1])
    assert caught.value.file == str(other)


def test_no_photo_is_overwritten(boards, files):
    with pytest.raises(OutputError):
        calibrate_from_chessboards(files, files[0], boards[1], overwrite=True)
