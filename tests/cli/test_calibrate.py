from __future__ import annotations

import json
import struct
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from deshake.files.kernel_file import read_camera


@pytest.fixture
def photo(tmp_path):
    """A portrait of 300 x 400 that lies on its side, taken with a 35 mm equivalent."""
    exif = Image.Exif()
    exif[0x0112] = 6
    exif.get_ifd(0x8769)[0xA405] = 35
    path = tmp_path / "portrait.jpg"
    Image.new("RGB", (400, 300), "teal").save(path, exif=exif)
    return path


def test_writes_the_camera_of_the_upright_photo(deshake, photo, tmp_path):
    outcome = deshake("calibrate", photo)
    assert (outcome.code, outcome.err) == (0, "")
    assert "404.5 pixels, 35.0 mm-equivalent (EXIF FocalLengthIn35mmFilm = 35 mm)" in outcome.out
    calibrated = read_camera(tmp_path / "portrait.camera.npz")
    assert calibrated.camera.shape == (400, 300)
    assert calibrated.camera.focal_px == pytest.approx(35 * 500 / np.hypot(36, 24))
    assert calibrated.camera.matrix[:2, 2].tolist() == [149.5, 199.5]
    assert calibrated.source == "EXIF FocalLengthIn35mmFilm = 35 mm"


def test_json_is_one_line_and_writes_nothing_unasked(deshake, photo, tmp_path):
    outcome = deshake("calibrate", photo, "--json")
    report = json.loads(outcome.out)
    assert report.pop("seconds") >= 0
    assert report == {
        "status": "done",
        "input": str(photo),
        "output": None,
        "focal_px": 404.469,
        "focal_35mm": 35,
        "source": "EXIF FocalLengthIn35mmFilm = 35 mm",
        "confidence": 0.81,
        "warnings": [],
        "width": 300,
        "height": 400,
    }
    assert list(tmp_path.iterdir()) == [photo]
    out = tmp_path / "c.npz"
    assert json.loads(deshake("calibrate", photo, "--json", "-o", out).out)["output"] == str(out)
    assert out.exists()


@pytest.mark.parametrize(
    ("option", "focal"), [(("--focal-px", 800), 800), (("--focal-35mm", 50), 577.78)]
)
def test_options_come_first(deshake, photo, tmp_path, option, focal):
    assert deshake("calibrate", photo, *option).code == 0
    calibrated = read_camera(tmp_path / "portrait.camera.npz")
    assert calibrated.camera.focal_px == pytest.approx(focal, rel=1e-4)
    assert calibrated.source == f"{option[0]} {option[1]}"


def test_no_source_is_an_error_with_a_hint(deshake, tmp_path):
    path = tmp_path / "bare.png"
    Image.new("L", (40, 30)).save(path)
    outcome = deshake("calibrate", path)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith(f"error: {path}: no focal length in its metadata\nhint: ")
    assert "--focal-35mm" in outcome.err
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "gps",
    [
        pytest.param((1, 2, 2, b"N\0"), id="sound"),
        pytest.param((2, 5, 2**32 - 1, b""), id="a count of gigabytes"),
        pytest.param((1, 99, 1, b"N\0"), id="a type that does not exist"),
    ],
)
def test_damage_beside_the_focal_length_does_no_harm(deshake, tmp_path, gps):
    def directory(*entries):
        packed = b"".join(struct.pack("<HHI4s", *entry) for entry in entries)
        return struct.pack("<H", len(entries)) + packed + bytes(4)

    pointers = [(34665, 4, 1, struct.pack("<I", 38)), (34853, 4, 1, struct.pack("<I", 56))]
    block = b"II*\0\10\0\0\0" + directory(*pointers)
    block += directory((0xA405, 3, 1, b"\43\0")) + directory(gps)
    path = tmp_path / "photo.jpg"
    Image.new("RGB", (400, 300), "teal").save(path, exif=b"Exif\0\0" + block)
    outcome = deshake("calibrate", path)
    assert (outcome.code, outcome.err) == (0, "")
    assert "404.5 pixels, 35.0 mm-equivalent (EXIF FocalLengthIn35mmFilm = 35 mm)" in outcome.out


def test_an_absurd_length_is_an_error(deshake, photo):
    outcome = deshake("calibrate", photo, "--focal-px", 3)
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {photo}: a focal length of 3 pixels (--focal-px 3)")


def test_refuses_to_replace(deshake, photo, tmp_path):
    out = tmp_path / "portrait.camera.npz"
    out.write_text("mine")
    assert "exists already" in deshake("calibrate", photo).err
    assert out.read_text() == "mine"
    assert deshake("calibrate", photo, "--overwrite").code == 0


def test_quiet_says_nothing(deshake, photo):
    assert deshake("calibrate", photo, "-q").out == ""


def test_standard_output_takes_one_thing(deshake, photo):
    done = subprocess.run(
        [sys.executable, "-m", "deshake", "calibrate", photo, "-o", "-"],
        capture_output=True,
        check=True,
    )
    assert done.stdout.startswith(b"PK")
    assert done.stderr == b""
    assert deshake("calibrate", photo, "-o", "-", "--json").code == 2


def test_verbose_shows_all_sources_that_were_considered(deshake, photo):
    outcome = deshake("calibrate", photo, "-v", "--json")
    assert outcome.code == 0
    assert f"{photo}: its EXIF does not say how large it was taken" in outcome.err
    assert "EXIF FocalLengthIn35mmFilm = 35 mm: 404.5 pixels, 35.0 mm" in outcome.err
    assert deshake("calibrate", photo, "--json").err == ""


def test_a_crop_is_noted(deshake, tmp_path):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0xA405: 35, 0xA002: 400, 0xA003: 300})
    path = tmp_path / "crop.jpg"
    Image.new("RGB", (300, 300), "teal").save(path, exif=exif)
    outcome = deshake("calibrate", path, "--json")
    report = json.loads(outcome.out)
    assert report["focal_px"] == pytest.approx(404.469)
    assert report["confidence"] == pytest.approx(0.63)
    assert outcome.err == f"warning: {path}: {report['warnings'][0]}\n"
    assert "taken to be a crop" in outcome.err


def test_an_anamorphic_lens_is_an_error(deshake, tmp_path):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0xA405: 35, 0xA434: "Anamorphic 50mm 1.33x"})
    path = tmp_path / "wide.jpg"
    Image.new("RGB", (300, 200), "teal").save(path, exif=exif)
    outcome = deshake("calibrate", path)
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {path}: its lens is Anamorphic 50mm 1.33x")
    assert "\nhint: stretch it" in outcome.err


@pytest.fixture
def board_files(boards, tmp_path):
    folder = tmp_path / "boards"
    folder.mkdir()
    for number, picture in enumerate(boards[0][:4]):
        Image.fromarray(picture).save(folder / f"{number}.png")
    return folder


def test_a_chessboard_gives_the_camera(deshake, boards, board_files, tmp_path):
    out = tmp_path / "camera.npz"
    by = ("--chessboard", "--board", "7x5")
    outcome = deshake("calibrate", *by, board_files, "-o", out)
    assert outcome.code == 0
    assert outcome.err.startswith("warning: no photo shows the board near the corners")
    assert outcome.out.startswith(f"{out}: ")
    assert "chessboard of 7x5 corners, 4 photos, error 0." in outcome.out
    camera = read_camera(out).camera
    assert camera.focal_px == pytest.approx(boards[2].focal_px, rel=0.02)
    assert not camera.is_pinhole
    report = json.loads(deshake("calibrate", *by, *sorted(board_files.iterdir()), "--json").out)
    assert report["focal_px"] == pytest.approx(camera.focal_px, abs=1e-3)
    assert report["output"] is None
    # and it is a camera for photos of its size
    fitting = board_files / "0.png"
    more = ("--camera", out, "--blur-size", 3, "--uniform", "--region", "20,20,80,60")
    kernel = tmp_path / "k.npz"
    args = ("-o", kernel, "--estimator", "edges", *more)
    assert deshake("estimate-blind", fitting, *args).code == 0


def test_boards_that_are_not_seen_are_named(deshake, board_files, tmp_path):
    out = tmp_path / "camera.npz"
    outcome = deshake("calibrate", "--chessboard", board_files, "-o", out)
    assert outcome.code == 1
    assert outcome.err.startswith("error: no board of 9x6 inner corners is seen in ")
    assert str(board_files / "3.png") in outcome.err
    assert "hint: the whole board" in outcome.err
    assert not out.exists()


@pytest.mark.parametrize(
    "wrong",
    [
        ("--board", "7x5"),
        ("--chessboard",),
        ("--chessboard", "-o", "c.npz", "--focal-px", 100),
        ("--chessboard", "-o", "c.npz", "--lens"),
        ("--chessboard", "-o", "c.npz", "--board", "2x5"),
    ],
)
def test_wrong_use_of_chessboards(deshake, photo, wrong):
    assert deshake("calibrate", photo, *wrong).code == 2
