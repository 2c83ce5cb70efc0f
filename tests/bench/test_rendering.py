"""Rendered cases agree with deshake's own operator, of which the rendering uses nothing."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
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


def test_what_is_missing_is_reported(places):
    with pytest.raises(MissingDataError, match=r"VID_20150510_204827.*--data names its folder"):
        places.check(CASE._replace(hand=1), "tune")
    with pytest.raises(MissingDataError, match=r"Debian's lomiri.*--scenes names its folder"):
        places.scene("kleiber")


def test_the_sets_share_no_scene_and_no_hand():
    scenes = [
        {name for case in cases for name in case.scene.split("+")} for cases in CASES.values()
    ]
    assert not scenes[0] & scenes[1]
    assert not set(HANDS["tune"]) & set(HANDS["test"])
    assert scenes[0] | scenes[1] <= set(SCENES)
    names = [case.name for cases in CASES.values() for case in cases]
    assert len(names) == len(set(names))
    assert {name[0] for name in names} == set(KINDS)
