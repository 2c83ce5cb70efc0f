from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from deshake.errors import CalibrationError, KernelFileError
from deshake.files.kernel_file import CameraFile, read_camera
from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.stages.calibration import calibrate, calibrate_file, camera_for
from deshake.stages.camera_choice import CameraChoice


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "a.jpg"
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 28
    exif.get_ifd(0x8769).update({0xA002: 100, 0xA003: 80})
    Image.new("RGB", (80, 70), "teal").save(path, exif=exif)
    return path


@pytest.fixture
def bare(tmp_path):
    path = tmp_path / "bare.png"
    Image.new("L", (80, 60)).save(path)
    return read_photo(path)


def test_a_calibration_has_its_source_and_what_was_cropped(photo):
    calibration = calibrate(read_photo(photo))
    assert calibration.camera.focal_px == pytest.approx(28 * np.hypot(100, 80) / np.hypot(36, 24))
    assert calibration.camera.matrix[:2, 2].tolist() == [39.5, 34.5]
    assert calibration.confidence == pytest.approx(0.63)
    [note] = calibration.notes
    assert "taken as 100 x 80 pixels, and has 80 x 70" in note
    assert calibration.considered[0] == "cropped from 100 x 80 pixels"
    assert calibration.report()["focal_35mm"] == pytest.approx(33.7319, abs=1e-3)


def test_an_option_has_full_confidence(photo):
    calibration = calibrate(read_photo(photo), focal_35mm=35)
    assert (calibration.source, calibration.confidence, calibration.notes) == (
        "--focal-35mm 35",
        1,
        [],
    )


def test_an_error_names_the_photo(bare):
    with pytest.raises(CalibrationError) as caught:
        calibrate(bare)
    assert caught.value.file == str(bare.source)


def test_the_camera_is_written_where_it_is_wanted(photo, tmp_path):
    calibration = calibrate_file(photo, None, focal_px=90)
    assert not list(tmp_path.glob("*.npz"))
    calibrate_file(photo, tmp_path / "c.npz", focal_px=90)
    assert np.array_equal(read_camera(tmp_path / "c.npz").camera.matrix, calibration.camera.matrix)


def test_the_camera_of_an_estimate(photo, bare):
    camera, [note] = camera_for(read_photo(photo), CameraChoice())
    assert "crop out of the whole frame" in note
    assert camera.source == "EXIF FocalLengthIn35mmFilm = 28 mm"
    camera, [note] = camera_for(bare, CameraChoice())
    assert "50 mm-equivalent is assumed" in note
    assert camera.camera.focal_px == pytest.approx(50 * 100 / np.hypot(36, 24))
    with pytest.raises(CalibrationError, match=r"--focal-px 1\) cannot be right"):
        camera_for(bare, CameraChoice(focal_px=1))


def test_a_given_camera_is_resized_with_its_lens(bare):
    lens = Camera.from_focal(300, 120, 160).with_lens(np.array([0.1, 0, 0, 0]))
    calibration, notes = camera_for(bare, CameraChoice(file=CameraFile(lens, "given")))
    assert notes == []
    assert calibration.camera.focal_px == pytest.approx(150)
    assert calibration.camera.distortion.tolist() == [0.1, 0, 0, 0]
    other = CameraFile(Camera.from_focal(300, 120, 180), "given")
    with pytest.raises(KernelFileError, match="the camera is for pictures of"):
        camera_for(bare, CameraChoice(file=other))
