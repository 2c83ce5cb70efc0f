"""Rendered cases agree with deshake's own operator, of which the rendering uses nothing."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from bench.cases import camera_files
from bench.cases.camera_files import CAMERA
from bench.cases.night import by_night
from bench.cases.rendering import is_rendered, render
from bench.cases.scenes import HANDS, SCENES, Places
from bench.cases.shakes import CASES, KINDS, Case, case_file
from bench.errors import MissingDataError

from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.operators.warps import Warps

CASE = Case("O00", "chelsea", 0.02, 8, 95, "low", 0.2, 0)


@pytest.fixture
def places(tmp_path):
    """Recordings of a hand that turns about all axes."""
    times = 0.005 * np.arange(400)
    angles = 0.02 * np.stack([np.sin(9 * times), np.cos(7 * times), np.sin(5 * times)], 1)
    lines = ["", ""]
    for time, angle in zip(times, angles, strict=True):
        numbers = ", ".join(f"{number:.9f}" for number in cv2.Rodrigues(angle)[0].ravel())
        lines.append(f"0, {round(1e9 * time)}, [{numbers}]")
    log = tmp_path / "data" / "gyro" / HANDS["tune"][0]
    log.parent.mkdir(parents=True)
    log.write_text("\n".join(lines), "utf-8")
    return Places(tmp_path / "data")


def test_a_case_is_the_mean_of_its_scene_over_the_path(places, tmp_path):
    folder = tmp_path / "cases"
    assert render(CASE, "tune", places, folder)
    assert is_rendered(CASE, folder)
    assert not render(CASE, "tune", places, folder)
    assert not is_rendered(CASE._replace(blur=9), folder)
    photo = read_photo(folder / CASE.photo)
    assert photo.metadata.tags().focal_35mm == CASE.film
    sharp = cv2.imread(str(case_file(folder, CASE, "_sharp.png")))[..., ::-1] / 255.0
    light = np.where(sharp <= 0.04045, sharp / 12.92, ((sharp + 0.055) / 1.055) ** 2.4)
    with np.load(case_file(folder, CASE, "_path.npz")) as path:
        camera = Camera.from_focal(float(path["f"]), *photo.shape)
        warps = Warps(camera, path["theta"])
    weights = np.full(len(warps.theta), 1 / len(warps.theta))
    margin = (warps.margin, warps.margin)
    blurred = warps.blur(np.pad(light.astype(np.float32), [margin, margin, (0, 0)]), weights)
    inner = np.s_[14:-14, 14:-14]
    difference = np.abs(photo.pixels - blurred)[inner].mean()
    assert difference < 0.3 * np.abs(photo.pixels - light)[inner].mean()


def test_a_camera_changes_the_tones_of_the_photo_and_of_the_truth(places, tmp_path):
    plain, camera = tmp_path / "plain", tmp_path / "camera"
    case = CASE._replace(noise="low")
    assert render(case, "tune", places, plain)
    assert render(case, "tune", places, camera, CAMERA)
    assert is_rendered(case, camera, CAMERA)
    assert not is_rendered(case, camera)
    assert not is_rendered(case, plain, CAMERA)
    truths, photos = (
        [cv2.imread(str(file(folder))) / 255.0 for folder in (plain, camera)]
        for file in (
            lambda folder: case_file(folder, case, "_sharp.png"),
            lambda folder: folder / case.photo,
        )
    )
    curve = camera_files.with_curve(truths[0].astype(np.float32))
    assert np.abs(truths[1] - curve).mean() < 0.01
    assert np.abs(truths[1] - truths[0]).mean() > 0.03
    blurred = camera_files.with_curve(photos[0].astype(np.float32))
    assert np.abs(photos[1] - blurred).mean() < 0.03
    assert np.abs(photos[1] - photos[0]).mean() > 0.03


def test_a_grey_scene_goes_through_a_camera():
    ramp = np.linspace(0, 1, 64, dtype=np.float32)[None].repeat(48, 0)
    shown = camera_files.photo(ramp, CASE)
    assert shown.shape == ramp.shape
    assert shown.min() >= 0
    assert shown.max() <= 1
    assert np.abs(shown - camera_files.LONG_CURVE.develop(ramp))[:, 4:-4].mean() < 0.02


def test_by_night_a_scene_is_dark_and_has_lamps_that_leave_streaks(places, tmp_path):
    case = CASE._replace(name="N00", size=0.03)
    for one in (case, case._replace(name="M00", blur=0)):
        assert render(one, "night-tune", places, tmp_path)
        assert one.shaken == (one.name == "N00")
        photo = read_photo(tmp_path / one.photo)
        assert np.median(photo.pixels) < 0.1
        assert 1e-4 < photo.clipped.mean() < 0.1
    assert CASE.shaken
    assert not CASE.at_night


def test_lamps_are_bright_spots_that_are_apart():
    scene = np.ones((400, 600, 3), np.float32)
    case = CASE._replace(name="N00")
    lit = by_night(scene, case, 2)
    assert np.array_equal(lit, by_night(scene, case, 2))
    assert (scene == 1).all()
    dark = np.median(lit)
    assert 0.06 <= dark <= 0.35
    spots, _, _, middles = cv2.connectedComponentsWithStats(
        (lit.max(2) > 4).astype(np.uint8), connectivity=8
    )
    assert 4 <= spots - 1 <= 25  # label 0 is the background
    away = np.linalg.norm(middles[1:, None] - middles[1:], axis=2)
    assert (away + 1e3 * np.eye(spots - 1)).min() > 2 * 12
    assert lit.max() > 10
    assert by_night(scene[..., 0], case, 2).ndim == 2


def test_what_is_missing_is_reported(places):
    with pytest.raises(MissingDataError, match=r"VID_20150510_204827.*--data names its folder"):
        places.check(CASE._replace(hand=1), "tune")
    with pytest.raises(MissingDataError, match=r"Debian's lomiri.*--scenes names its folder"):
        places.scene("kleiber")


def test_the_sets_share_no_scene_and_no_hand():
    scenes = {
        split: {name for case in cases for name in case.scene.split("+")}
        for split, cases in CASES.items()
    }
    assert set().union(*scenes.values()) <= set(SCENES)
    for one in ("tune", "night-tune"):
        for other in ("test", "night-test"):
            assert not scenes[one] & scenes[other]
            assert not set(HANDS[one]) & set(HANDS[other])
    names = [case.name for cases in CASES.values() for case in cases]
    assert len(names) == len(set(names))
    assert {name[0] for name in names} == set(KINDS)
