from __future__ import annotations

import sys

import numpy as np
import pytest

from deshake.errors import CalibrationError
from deshake.geometry.camera import Camera
from deshake.geometry.distortion import distorted
from deshake.lens import lens_profiles
from deshake.lens.lens_profiles import crop_factor, find_profile
from deshake.metadata.metadata import CameraTags

lensfun = pytest.importorskip("lensfunpy")

EOS = CameraTags(
    make="Canon", model="Canon EOS 5D Mark II", focal_mm=24.0, lens_model="EF24-105mm f/4L IS USM"
)
FRAME = (5616.0, 3744.0)
FOCAL_PX = 24 * 5616 / 36


def test_names_match_exactly() -> None:
    assert crop_factor("Apple", "iPhone XS") == pytest.approx(6.118, abs=1e-3)
    assert crop_factor("Apple", "iPhone 15") is None
    assert crop_factor("CANON", "canon eos 5d mark ii") == 1
    assert crop_factor("Canon", "Canon EOS 5D Mark") is None
    assert crop_factor("", "") is None


def test_crop_factors_that_depend_on_a_setting_are_not_guessed() -> None:
    assert crop_factor("Panasonic", "DMC-LX3") is None


@pytest.mark.parametrize("name", ["EF24-105mm f/4L IS USM", "Canon EF 24-105mm f/4L IS USM"])
def test_the_lens_is_that_of_the_exif(name: str) -> None:
    tags = CameraTags(make="Canon", model=EOS.model, focal_mm=24.0, lens_model=name)
    profile = find_profile(tags, FOCAL_PX, FRAME)
    assert profile.lens == "Canon EF 24-105mm f/4L IS USM"
    assert profile.error_px < 0.1


def test_the_fit_is_lensfuns_own_curve() -> None:
    profile = find_profile(EOS, FOCAL_PX, FRAME)
    camera = Camera.from_focal(FOCAL_PX, 3744, 5616)
    lens = next(
        item
        for item in lensfun.Database().lenses
        if item.model == profile.lens and item.crop_factor == 1
    )
    modifier = lensfun.Modifier(lens, 1.0, 5616, 3744)
    flags = lensfun.ModifyFlags.DISTORTION
    modifier.initialize(24.0, 8.0, 1000.0, scale=1.0, flags=flags)
    points = np.array(
        [(0.0, 0), (5615, 3743), (2807.5, 0), (0, 1871.5), (1000, 3000), (2000, 1500)]
    )
    theirs = np.array([modifier.apply_geometry_distortion(*p, 1, 1)[0, 0] for p in points])
    # their straight picture is ours at another scale; the middle gives the scale
    near = np.array([[2807.5 + 20, 1871.5]])
    [[x, y]] = modifier.apply_geometry_distortion(*near[0], 1, 1)[0, :]
    scale = (x - 2807.5) / 20
    straight_camera = Camera.from_focal(FOCAL_PX / scale, 3744, 5616)
    ours = distorted(points, camera.with_lens(profile.distortion), straight_camera)
    assert np.abs(points - theirs).max() > 20
    assert y == pytest.approx(1871.5, abs=1e-3)
    np.testing.assert_allclose(ours, theirs, atol=1.0)


def test_the_distortion_changes_with_the_focal_length() -> None:
    tags = CameraTags(make="Canon", model=EOS.model, focal_mm=105.0, lens_model=EOS.lens_model)
    tele = find_profile(tags, 105 * 5616 / 36, FRAME)
    wide = find_profile(EOS, FOCAL_PX, FRAME)
    corner = np.array([[2807.5 + 2400, 1871.5 + 1600]])
    moved = []
    for profile, focal in ((wide, FOCAL_PX), (tele, 105 * 5616 / 36)):
        camera = Camera.from_focal(focal, 3744, 5616).with_lens(profile.distortion)
        moved.append(float((distorted(corner, camera, camera) - corner)[0, 0]))
    assert moved[0] < -20  # a barrel
    assert moved[1] > 10  # a cushion


def test_a_built_in_lens_needs_no_name() -> None:
    tags = CameraTags(make="Canon", model="Canon DIGITAL IXUS 70", focal_mm=5.8)
    profile = find_profile(tags, 2627.0, (2592.0, 1944.0))
    assert profile.lens == "Canon PowerShot SD200 & compatibles (Standard)"


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"model": "Canon EOS 5D Mark XII"}, "lensfun has no camera Canon Canon EOS 5D Mark XII"),
        ({"lens_model": "EF24-105mm f/4L IS"}, "no profile of EF24-105mm f/4L IS on"),
        ({"lens_model": ""}, "no profile of the lens on"),
        ({"focal_mm": 300.0}, "taken at 300 mm, and Canon EF 24-105mm"),
        ({"focal_mm": None}, "no focal length in its metadata"),
    ],
)
def test_names_that_do_not_match_are_refused(changes: dict, match: str) -> None:
    tags = CameraTags(**{**vars(EOS), **changes})
    with pytest.raises(CalibrationError, match=match) as caught:
        find_profile(tags, FOCAL_PX, FRAME)
    assert caught.value.hint


def test_a_near_miss_is_offered_not_taken() -> None:
    tags = CameraTags(**{**vars(EOS), "lens_model": "EF 24-105 f/4"})
    with pytest.raises(CalibrationError) as caught:
        find_profile(tags, FOCAL_PX, FRAME)
    assert "Canon EF 24-105mm f/4L IS USM" in str(caught.value.hint)


def test_a_lens_may_be_named() -> None:
    tags = CameraTags(make="Nobody", model="Nothing", focal_mm=24.0)
    profile = find_profile(tags, FOCAL_PX, FRAME, lens="canon ef 24-105mm f/4l is usm")
    assert np.array_equal(profile.distortion, find_profile(EOS, FOCAL_PX, FRAME).distortion)
    with pytest.raises(CalibrationError, match="lensfun has no lens 'X'"):
        find_profile(tags, FOCAL_PX, FRAME, lens="X")


def test_fisheyes_and_smaller_sensors_are_refused() -> None:
    with pytest.raises(CalibrationError, match="is a fisheye"):
        find_profile(CameraTags(focal_mm=8.0), 1300.0, FRAME, lens="Samyang 8mm f/3.5 Fish-Eye CS")
    with pytest.raises(CalibrationError, match="on smaller sensors only"):
        find_profile(
            CameraTags(focal_mm=18.0), 2808.0, FRAME, lens="Canon EF-S 18-55mm f/3.5-5.6 IS"
        )


def test_without_lensfunpy_a_hint_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    lens_profiles._database.cache_clear()
    monkeypatch.setitem(sys.modules, "lensfunpy", None)
    with pytest.raises(CalibrationError, match="need lensfunpy") as caught:
        find_profile(EOS, FOCAL_PX, FRAME)
    assert "deshake[lens]" in str(caught.value.hint)
    assert crop_factor("Canon", "Canon EOS 5D Mark II") is None
