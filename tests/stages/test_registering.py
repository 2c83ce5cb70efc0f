from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from deshake.errors import PhotoError
from deshake.files.registration_file import read_registration
from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.pair.registration import Registration
from deshake.run import Run
from deshake.stages import registering
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.registering import checkerboard, register_file, registration_name

NEAR = EstimateOptions(camera=CameraChoice(focal_35mm=40), search_angle=4)  # a quick search


@pytest.fixture
def pair(tmp_path):
    """A blurred photo in colour, and a grey one 4 pixels further left, darker and noisy."""
    light = cv2.resize(data.coffee(), (240, 160), interpolation=cv2.INTER_AREA) / 255.0
    blurred = cv2.blur(light[:, 4:204], (5, 1))
    noisy = light[:, :200].mean(-1) / 4
    noisy += np.random.default_rng(0).normal(0, 0.01, noisy.shape)
    names = tmp_path / "long.png", tmp_path / "short.png"
    for path, image in zip(names, (blurred, noisy), strict=True):
        Image.fromarray(np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)).save(path)
    return names


def test_registrations_are_named_after_the_blurred_photo(tmp_path):
    assert registration_name(tmp_path / "a.b.jpg") == "a.b.registration.npz"


def test_a_shift_is_estimated_and_written(pair, tmp_path):
    options = replace(NEAR, transfer="linear")
    match = register_file(*pair, tmp_path / "r.npz", options, run=Run(1))
    read = read_registration(tmp_path / "r.npz")
    assert np.array_equal(read.theta, match.registration.theta)
    assert read.scale == match.registration.scale == pytest.approx(4, rel=0.1)
    shift = match.registration.theta[1] * match.registration.camera.focal_px
    assert abs(shift) == pytest.approx(4, abs=0.7)
    assert read.provenance["options"] == {"transfer": "linear", "search_angle": 4}
    assert len(read.provenance["noisy_sha256"]) == 64
    assert read.provenance["noisy_sha256"] != read.provenance["input_sha256"]


def test_the_checkerboard_shows_both(tmp_path):
    height, width = 100, 150
    for name, value in (("g.png", 200), ("n.png", 50)):
        Image.new("L", (width, height), value).save(tmp_path / name)
    g, noisy = read_photo(tmp_path / "g.png"), read_photo(tmp_path / "n.png")
    camera = Camera.from_focal(150, height, width)
    board = checkerboard(g, noisy, Registration(np.zeros(3), 2.0, 1.0, camera)).pixels
    low, high = 2 * noisy.pixels[0, 0], g.pixels[0, 0]
    assert {round(float(v), 4) for v in np.unique(board)} == {
        round(float(low), 4),
        round(float(high), 4),
    }
    assert board[0, 0] == board[15, 15] == high
    assert board[0, 15] == board[15, 0] == low
    aside = Registration(np.radians([0, 20, 0]), 2.0, 1.0, camera)
    unseen = checkerboard(g, noisy, aside).pixels
    assert (unseen == high).mean() > (board == high).mean() + 0.1


@pytest.mark.parametrize("name", ["p.png", "p.jpg", "p.tif"])
def test_the_preview_is_of_the_format_of_its_name(pair, tmp_path, name):
    register_file(*pair, tmp_path / "r.npz", NEAR, preview=tmp_path / name, run=Run(1))
    with Image.open(tmp_path / name) as picture:
        assert picture.size == (200, 160)
        assert picture.mode == "L"  # one of the two is grey


@pytest.mark.parametrize("step", ["encode_photo", "registration_bytes"])
def test_file_and_preview_stay_together(pair, tmp_path, monkeypatch, step):
    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(registering, step, fail)
    with pytest.raises(KeyboardInterrupt):
        register_file(*pair, tmp_path / "r.npz", NEAR, preview=tmp_path / "p.png", run=Run(1))
    assert {path.name for path in tmp_path.iterdir()} == {"long.png", "short.png"}


def with_focal_length(path, millimetres, target):
    with Image.open(path) as picture:
        exif = picture.getexif()
        exif.get_ifd(0x8769)[0xA405] = millimetres
        picture.convert("RGB").save(target, exif=exif, quality=95)
    return target


def test_a_zoom_between_the_two_is_an_error(pair, tmp_path):
    g = with_focal_length(pair[0], 35, tmp_path / "g.jpg")
    same = with_focal_length(pair[1], 35, tmp_path / "same.jpg")
    zoomed = with_focal_length(pair[1], 50, tmp_path / "zoomed.jpg")
    match = register_file(g, same, tmp_path / "r.npz", EstimateOptions(search_angle=4), run=Run(1))
    assert "35 mm" in match.camera.source
    with pytest.raises(PhotoError, match=r"taken at 1\.43 times the focal length of"):
        register_file(g, zoomed, tmp_path / "z.npz", EstimateOptions(search_angle=4), run=Run(1))
    register_file(
        g,
        zoomed,
        tmp_path / "z.npz",
        EstimateOptions(camera=CameraChoice(focal_35mm=35), search_angle=4),
        run=Run(1),
    )
