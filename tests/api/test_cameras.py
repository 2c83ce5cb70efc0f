from __future__ import annotations

import json

import numpy as np
import piexif
import pytest
from PIL import Image

import deshake as library
from deshake.api.cameras import calibrate, chosen_camera
from deshake.errors import CalibrationError, DeshakeError
from deshake.geometry.camera import Camera


@pytest.fixture
def tagged(tmp_path):
    exif = piexif.dump({"Exif": {piexif.ExifIFD.FocalLengthIn35mmFilm: 50}})
    Image.new("RGB", (120, 80), (90, 90, 90)).save(tmp_path / "a.jpg", exif=exif)
    return tmp_path / "a.jpg"


def test_a_photo_has_the_camera_that_the_command_prints(tagged, deshake):
    result = deshake("calibrate", tagged, "--json")
    assert result.code == 0
    camera = calibrate(library.read_photo(tagged))
    assert camera.shape == (80, 120)
    assert round(camera.focal_px, 3) == json.loads(result.out)["focal_px"]


def test_an_array_takes_a_focal_length():
    assert calibrate(np.full((80, 120), 0.5), focal_px=99.0).focal_px == 99.0
    with pytest.raises(CalibrationError, match="the array"):
        calibrate(np.full((80, 120), 0.5))


def test_focal_lengths_are_one_and_above_zero():
    with pytest.raises(ValueError, match="cannot both be given"):
        calibrate(np.full((80, 120), 0.5), focal_px=99.0, focal_35mm=50.0)
    with pytest.raises(ValueError, match="focal_35mm is -5"):
        calibrate(np.full((80, 120), 0.5), focal_35mm=-5)


def test_the_choice_of_a_camera_is_that_camera_or_the_metadata():
    assert chosen_camera(None).file is None
    camera = Camera.from_focal(100.0, 80, 120)
    assert chosen_camera(camera).file.camera is camera
    with pytest.raises(DeshakeError, match="not a Camera: float"):
        chosen_camera(100.0)
