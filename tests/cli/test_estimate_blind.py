from __future__ import annotations

import hashlib
import io
import json
import subprocess
import sys
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from deshake.blind.agreement import agreement
from deshake.cli.main import main
from deshake.files.kernel_file import CameraFile, read_kernel, write_camera
from deshake.formats.transfer import SRGB
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur
from tests.support.night import PATH, kernel_of, night

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.long

FAST = ("--blur-size", 3)
FREE = (*FAST, "--estimator", "edges")
EDGES = (*FREE, "--uniform")
LENS = ("--focal-35mm", 40)
PART = ("--region", "10,5,80,60")


def test_writes_a_kernel_that_does_not_roll_and_its_provenance(deshake, shaken, tmp_path):
    photo = shaken("a.jpg", large=True, size=(150, 120))
    outcome = deshake("estimate-blind", photo, "--blur-size", 9, *LENS, "--uniform", "--json")
    assert outcome.code == 0
    content = read_kernel(tmp_path / "a.kernel.npz")
    assert content.kernel.camera.shape == (120, 150)
    assert content.kernel.extent_px() > 5
    assert content.kernel.camera.is_uniform
    assert abs(content.kernel.theta[:, 2]).max() < 1e-9
    report = json.loads(outcome.out)
    assert report["input"] == str(photo)
    assert report["output"] == str(tmp_path / "a.kernel.npz")
    assert report["rotations"] == len(content.kernel.weights) > 5
    assert report["extent_px"] == pytest.approx(content.kernel.extent_px(), abs=0.01)
    assert report["confidence"] == pytest.approx(content.confidence, abs=1e-4)
    assert report["camera_source"] == "--focal-35mm 40"
    provenance = content.provenance
    assert provenance["command"] == "estimate-blind"
    assert provenance["options"] == {
        "transfer": None,
        "blur_size": 9,
        "max_angle": None,
        "region": None,
        "uniform": True,
        "estimator": "edges",
    }
    assert provenance["input_sha256"] == hashlib.sha256(photo.read_bytes()).hexdigest()
    assert provenance["camera"] == "--focal-35mm 40"
    assert provenance["notes"] == report["warnings"]
    assert "start " in provenance["estimated_by"]
    assert str(tmp_path) not in json.dumps(provenance)
    for note in report["warnings"]:
        assert f"warning: {photo}: {note}" in outcome.err


def test_a_camera_file_stands_for_the_options(deshake, sharp_photo, tmp_path):
    photo = sharp_photo("a.jpg")
    deshake("calibrate", photo, *LENS, "-o", tmp_path / "c.npz")
    for name, lens in (("one", LENS), ("two", ("--camera", tmp_path / "c.npz"))):
        args = (*EDGES, *PART, *lens, "-o", tmp_path / name)
        assert deshake("estimate-blind", photo, *args).code == 0
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_an_assumed_lens_is_reported(deshake, sharp_photo, tmp_path):
    photo = sharp_photo("a.jpg")
    outcome = deshake("estimate-blind", photo, *FREE, *PART)
    assert outcome.code == 0
    assert f"warning: {photo}: no focal length in its metadata; a 50 mm-equ" in outcome.err
    camera = read_kernel(tmp_path / "a.kernel.npz").kernel.camera
    assert camera.focal_px == pytest.approx(148, abs=1)


def test_a_region_shapes_the_kernel_of_the_whole_photo(deshake, shaken, tmp_path):
    assert deshake("estimate-blind", shaken("a.jpg"), *EDGES, *PART).code == 0
    content = read_kernel(tmp_path / "a.kernel.npz")
    assert content.kernel.camera.shape == (80, 100)
    assert content.provenance["options"]["region"] == [10, 5, 80, 60]


def test_an_angle_bounds_the_blur(deshake, shaken, tmp_path):
    args = (*LENS, "--max-angle", "1.5", "--estimator", "edges", "--uniform")
    assert deshake("estimate-blind", shaken("a.jpg"), *args).code == 0
    content = read_kernel(tmp_path / "a.kernel.npz")
    assert content.provenance["options"]["max_angle"] == 1.5
    assert content.kernel.extent_px() < 12


@pytest.fixture
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (("--region", "50,0,60,80"), "the region 50,0,60,80 reaches beyond its 100 x 80 pixels"),
        (("--region", "0,0,20,20"), "20x20 pixels are too few"),
        (("--blur-size", 90), "a blur of 90 px does not fit"),
        (("--focal-px", 1), "a focal length of 1 pixels (--focal-px 1) cannot be right"),
        (("--camera", "other.npz"), "is for pictures of 100 x 100 pixels, and"),
        (("--camera", "turned.npz"), "is for pictures of 160 x 200 pixels, and"),
        (("--camera", "none.npz"), "none.npz: no such file"),
        (("-o", "nowhere/k.npz"), "nowhere: no such folder"),
    ],
)
@pytest.mark.usefixtures("_here")
def test_what_does_not_fit_is_one_line(deshake, sharp_photo, args, what):
    photo = sharp_photo("a.jpg")
    write_camera("other.npz", CameraFile(Camera.from_focal(90, 100, 100), "made up"))
    write_camera("turned.npz", CameraFile(Camera.from_focal(90, 200, 160), "made up"))
    outcome = deshake("estimate-blind", photo, *args)
    assert outcome.code == 1
    [line] = [line for line in outcome.err.splitlines() if line.startswith("error: ")]
    assert what in line
    assert not photo.with_suffix(".kernel.npz").exists()


def test_json_and_standard_output_exclude_each_other(deshake, shaken):
    assert deshake("estimate-blind", shaken("a.jpg"), "-o", "-", "--json").code == 2


def write_street(folder: Path, width: int, height: int) -> tuple[Path, np.ndarray]:
    """Write a photograph turned by six pixels about Y; also the sharp one in linear light."""
    grey = data.coffee()[:, 40:560] @ np.array([0.3, 0.59, 0.11]) / 255
    small = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    sharp = (small**2.2).astype(np.float32)
    camera = Camera.from_focal(float(width), height, width)
    path = np.array([[0, -3, 0], [0, 3, 0]]) * grid_steps(camera)
    blur = ShakeBlur(RotationKernel.from_path(path, camera))
    light = blur.forward(np.pad(sharp, blur.margin, mode="edge"))
    codes = np.rint(255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    Image.fromarray(codes).save(folder / "street.png")
    return folder / "street.png", sharp


def light_of(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        assert picture.mode == "L"
        return (np.asarray(picture, np.float32) / 255) ** 2.2


def fine(picture: np.ndarray) -> np.ndarray:
    """What is finer than some pixels, away from the border."""
    return (picture - cv2.GaussianBlur(picture, (0, 0), 4))[10:-10, 10:-10].ravel()


def test_the_latent_picture_is_sharper_than_the_photo(deshake, tmp_path):
    photo, sharp = write_street(tmp_path, 120, 92)
    latent = tmp_path / "latent.png"
    args = ("--estimator", "variational", "--blur-size", 8, "--focal-px", 120)
    outcome = deshake("estimate-blind", photo, *args, "--latent", latent, "--json")
    assert outcome.code == 0
    assert json.loads(outcome.out)["latent"] == str(latent)
    before, after = (
        1 - np.corrcoef(fine(light_of(path)), fine(sharp))[0, 1] for path in (photo, latent)
    )
    assert after < 0.7 * before
    assert light_of(latent).mean() == pytest.approx(light_of(photo).mean(), rel=0.03)


@pytest.mark.parametrize(("option", "mode"), [("--latent", "L"), ("--tiles", "RGB")])
def test_a_picture_goes_to_standard_output(sharp_photo, tmp_path, capfdbinary, option, mode):
    command = ["estimate-blind", sharp_photo("a.jpg"), "-q", *EDGES, option, "-"]
    words = list(map(str, command))
    if option == "--latent":
        subprocess.run([sys.executable, "-m", "deshake", *words], check=True)
    else:
        assert main(words) == 0
    with Image.open(io.BytesIO(capfdbinary.readouterr().out)) as picture:
        assert (picture.format, picture.mode, picture.width) == ("PNG", mode, 100)
        assert picture.height == 80 if mode == "L" else picture.height > 80
    assert (tmp_path / "a.kernel.npz").exists()


def test_the_tiles_are_drawn_on_the_photo(deshake, tmp_path):
    photo, _ = write_street(tmp_path, 143, 110)
    tiles = tmp_path / "t.png"
    args = ("--uniform", "--blur-size", 10, "--tiles", tiles, "--json")
    outcome = deshake("estimate-blind", photo, *args)
    assert outcome.code == 0
    report = json.loads(outcome.out)
    assert report["tiles"] == str(tiles)
    assert 5 < report["extent_px"] < 10
    with Image.open(tiles) as picture:
        assert (picture.format, picture.mode, picture.width) == ("PNG", "RGB", 143)
        colours = np.asarray(picture).astype(int)[:110]
    coloured = np.ptp(colours, axis=-1) > 100  # the photo is grey
    assert 0.01 < coloured.mean() < 0.3
    assert colours.max() > 240  # a filter's light


def test_a_photo_by_night_shows_the_path_in_the_streaks_of_its_lamps(deshake, tmp_path):
    true = kernel_of(PATH)
    photo = tmp_path / "night.png"
    codes = np.rint(65535 * SRGB.from_linear(night(true)[0])).astype(np.uint16)
    cv2.imwrite(str(photo), np.dstack([codes] * 3))
    write_camera(tmp_path / "c.npz", CameraFile(true.camera, "by hand"))
    args = ("--camera", tmp_path / "c.npz", "--tiles", tmp_path / "t.png", "--json")
    outcome = deshake("estimate-blind", photo, *args)
    assert outcome.code == 0
    assert json.loads(outcome.out)["confidence"] > 0.9
    content = read_kernel(tmp_path / "night.kernel.npz")
    assert content.provenance["estimated_by"] == "the streaks of lights"
    assert agreement(content.kernel, true) > 0.85
    with Image.open(tmp_path / "t.png") as picture:
        drawn = np.asarray(picture).astype(int)[:150]
    coloured = np.ptp(drawn, axis=-1) > 100
    assert coloured.any()
    assert not (coloured & (drawn[..., 2] > drawn[..., 0])).any()  # boxes around streaks, no tiles


def test_tiles_are_drawn_on_a_sharp_raw_photo(deshake, make_dng, sharp, tmp_path):
    (tmp_path / "raw.dng").write_bytes(make_dng(np.dstack([0.8 * sharp] * 3)))
    args = (*EDGES, "--tiles", tmp_path / "t.png", "--json")
    outcome = deshake("estimate-blind", tmp_path / "raw.dng", *args)
    assert outcome.code == 0
    assert json.loads(outcome.out)["extent_px"] == 0
    with Image.open(tmp_path / "t.png") as picture:
        assert (picture.mode, picture.width) == ("RGB", 260)
        assert picture.height > 200


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("there.png", "there.png: exists already"),
        ("a.jpg", "a.jpg: the output is the input itself"),
        ("a.kernel.npz", "a.kernel.npz: the output is the input itself"),
        ("l.gif", "no photo format ends in '.gif'"),
        ("none/l.png", "none: no such folder"),
    ],
)
@pytest.mark.parametrize("option", ["--latent", "--tiles"])
def test_a_picture_that_cannot_be_is_one_line(*, refused, shaken, tmp_path, option, name, what):
    photo = shaken("a.jpg")
    (tmp_path / "there.png").write_text("mine")
    assert what in refused("estimate-blind", photo, option, tmp_path / name)


def test_two_pictures_do_not_share_a_file(refused, shaken, tmp_path):
    both = tmp_path / "p.png"
    errors = refused("estimate-blind", shaken("a.jpg"), "--latent", both, "--tiles", both)
    assert "p.png: the output is the input itself" in errors


@pytest.mark.parametrize("option", ["--latent", "--tiles"])
def test_two_photos_do_not_share_a_picture(deshake, sharp_photo, contents, tmp_path, option):
    photos = sharp_photo("a.jpg"), sharp_photo("b.jpg")
    before = contents(tmp_path)
    outcome = deshake("estimate-blind", *photos, *EDGES, option, tmp_path / "p.png")
    assert outcome.code != 0
    assert "p.png" in outcome.err
    assert contents(tmp_path) == before


@pytest.mark.parametrize("option", ["--latent", "--tiles"])
@pytest.mark.parametrize(
    "args", [("--json",), ("-o", "-"), ("-o", "-", "--json"), ("--latent", "-", "--tiles", "-")]
)
def test_only_one_thing_goes_to_standard_output(deshake, shaken, option, args):
    outcome = deshake("estimate-blind", shaken("a.jpg"), option, "-", *args)
    assert outcome.code == 2
    assert "cannot go to standard output together" in outcome.err
    assert outcome.out == ""


@pytest.mark.parametrize("other", [("--focal-px", 90), ("--camera", "c.npz"), ("--lens",)])
def test_a_focal_length_is_known_or_estimated(deshake, shaken, other):
    outcome = deshake("estimate-blind", shaken("a.png"), "--focal", "auto", *other)
    assert outcome.code == 2
    assert "cannot both be given" in outcome.err


def test_a_pair_estimates_no_focal_length(deshake, pair):
    outcome = deshake("fix", pair[0], "--noisy", pair[1], "--focal", "auto")
    assert outcome.code == 2
    assert "--focal does not go with --noisy" in outcome.err


def test_a_least_confidence_of_nothing_deblurs_a_photo_that_looks_sharp(
    deshake, sharp_photo, tmp_path
):
    photo, kernel = sharp_photo("a.jpg"), tmp_path / "a.kernel.npz"
    assert deshake("estimate-blind", photo, *EDGES).code == 0
    assert read_kernel(kernel).kernel.is_still
    outcome = deshake("estimate-blind", photo, *EDGES, "--least-confidence", "0%", "--overwrite")
    assert outcome.code == 0
    assert "the estimate of the shake is doubtful" in outcome.err
    content = read_kernel(kernel)
    assert not content.kernel.is_still
    assert content.provenance["options"]["least_confidence"] == 0
    out = tmp_path / "a.deshaken.jpg"
    args = (*EDGES, "--least-confidence", 0)
    assert deshake("fix", photo, *args).code == 0
    assert deshake("deblur", photo, kernel, "-o", tmp_path / "b.jpg").code == 0
    assert (tmp_path / "b.jpg").read_bytes() == out.read_bytes() != photo.read_bytes()


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--least-confidence", 2), "'2' is not a share: a number from 0 to 1"),
        (
            ("--least-confidence", 0, "--estimator", "variational"),
            "--least-confidence needs --estimator edges",
        ),
    ],
)
def test_a_least_confidence_is_a_share_for_edges(deshake, shaken, args, said):
    outcome = deshake("estimate-blind", shaken("a.png"), *args)
    assert outcome.code == 2
    assert said in outcome.err
    assert outcome.out == ""


def test_the_variational_estimator_does_not_estimate_a_focal_length(deshake, shaken):
    args = ("--focal", "auto", "--estimator", "variational")
    outcome = deshake("estimate-blind", shaken("a.png"), *args)
    assert outcome.code == 2
    assert "--focal auto needs --estimator edges" in outcome.err
    assert outcome.out == ""
