from __future__ import annotations

import json
import re
import subprocess
import sys

import cv2
import numpy as np
import pytest
from PIL import Image

from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.files.registration_file import RegistrationFile, write_registration
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel


@pytest.fixture
def folder(tmp_path, sharp):
    """A sharp photo, a shaken one, and one out of focus; the last in a folder below."""
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)).astype(np.float32)
    photos = {
        "sharp.jpg": sharp,
        "shaken.jpg": cv2.blur(sharp, (9, 1)),
        "below/round.png": cv2.filter2D(sharp, -1, disk / disk.sum()),
    }
    (tmp_path / "in" / "below").mkdir(parents=True)
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 28
    for name, light in photos.items():
        codes = np.rint(255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)
        Image.fromarray(codes).save(tmp_path / "in" / name, quality=92, exif=exif)
    return tmp_path / "in"


def test_describes_one_photo_in_lines(deshake, folder, contents):
    before = contents(folder)
    outcome = deshake("inspect", folder / "shaken.jpg")
    assert (outcome.code, outcome.err) == (0, "")
    first, *rows = outcome.out.splitlines()
    assert re.fullmatch(r".*shaken\.jpg: shaken, about \d+ px at \d+ degrees", first.rstrip())
    assert "  size          260 x 200 px" in rows
    assert any(re.fullmatch(r"  noise +\S+ % of white at a mid grey", row) for row in rows)
    assert "28 mm-equivalent (EXIF FocalLengthIn35mmFilm = 28 mm)" in rows[-1]
    assert contents(folder) == before


def test_describes_a_folder_in_a_line_each(deshake, folder):
    outcome = deshake("inspect", folder, "-r", "-j", 2)
    assert outcome.code == 0
    lines = sorted(outcome.out.splitlines())
    assert [line.split("  ")[0].rpartition("/")[2] for line in lines] == [
        "round.png",
        "shaken.jpg",
        "sharp.jpg",
    ]
    assert "out of focus" in lines[0]
    assert "shaken, about" in lines[1]
    assert len({line.index("noise") for line in lines}) == 1
    summary, counts = outcome.err.splitlines()
    assert summary.startswith("3 photos: 3 done")
    assert sorted(counts.strip().split(", ")) == ["1 perhaps out of focus", "1 shaken", "1 sharp"]


def test_json_is_an_object_a_line(deshake, folder):
    outcome = deshake("inspect", folder, "--json")
    assert outcome.code == 0
    reports = {report["input"]: report for report in map(json.loads, outcome.out.splitlines())}
    assert len(reports) == 2
    shaken = reports[str(folder / "shaken.jpg")]
    assert (shaken["status"], shaken["kind"], shaken["verdict"]) == ("done", "photo", "shaken")
    assert shaken["certain"] is True
    assert shaken["width_px"] > 3
    assert min(shaken["direction"], 180 - shaken["direction"]) < 20
    assert shaken["output"] is None
    assert shaken["focal_35mm"] == pytest.approx(28, abs=0.01)
    assert reports[str(folder / "sharp.jpg")]["verdict"] == "sharp"


def test_a_photo_without_focal_length_says_what_is_assumed(deshake, folder):
    Image.open(folder / "sharp.jpg").convert("L").save(folder / "bare.png")
    outcome = deshake("inspect", folder / "bare.png")
    assert outcome.code == 0
    assert "50 mm-equivalent" in outcome.out


def test_describes_a_kernel_and_how_it_was_made(deshake, tmp_path):
    camera = Camera.from_focal(300.0, 40, 60)
    kernel = RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera)
    provenance = {
        "deshake": "9.9",
        "command": "estimate-blind",
        "options": {"blur_px": 12, "region": None},
        "input_sha256": "abcd",
        "notes": ["the kernel is doubtful"],
    }
    write_kernel(tmp_path / "k.npz", KernelFile(kernel, 0.75, provenance))
    outcome = deshake("inspect", tmp_path / "k.npz")
    assert outcome.code == 0
    rows = [" ".join(row.split()) for row in outcome.out.splitlines()]
    assert rows[0] == f"{tmp_path / 'k.npz'}: kernel of rotations"
    for row in (
        f"extent {kernel.extent_px():.3g} px",
        f"weights {len(kernel.weights)}",
        "confidence 0.75",
        "size 60 x 40 px",
        "made by deshake 9.9 estimate-blind",
        "photo SHA-256 abcd",
        "options blur_px=12",
        "note the kernel is doubtful",
    ):
        assert row in rows
    report = json.loads(deshake("inspect", tmp_path / "k.npz", "--json").out)
    assert report["provenance"] == provenance


def test_describes_a_result_and_how_it_was_made(deshake, shaken, pan):
    photo = shaken("a.jpg")
    assert deshake("deblur", photo, pan, "-q").code == 0
    result = photo.with_name("a.deshaken.jpg")
    outcome = deshake("inspect", result)
    assert outcome.code == 0
    rows = [" ".join(row.split()) for row in outcome.out.splitlines()]
    assert any(re.fullmatch(r"made by deshake \S+ deblur", row) for row in rows)
    assert any(re.fullmatch(r"photo SHA-256 [0-9a-f]{64}", row) for row in rows)
    assert any(row.startswith("options ") and "method=" in row for row in rows)
    report = json.loads(deshake("inspect", result, "--json").out)
    assert (report["kind"], report["provenance"]["command"]) == ("photo", "deblur")


def test_describes_camera_and_registration_files(deshake, folder, tmp_path):
    assert deshake("calibrate", folder / "sharp.jpg", "-o", tmp_path / "c.npz").code == 0
    camera = Camera.from_focal(300.0, 40, 60)
    write_registration(tmp_path / "r.npz", RegistrationFile(np.radians([0.5, 0, 2]), 4.0, camera))
    outcome = deshake("inspect", tmp_path / "c.npz")
    assert "camera file" in outcome.out
    assert "EXIF FocalLengthIn35mmFilm = 28 mm" in outcome.out
    outcome = deshake("inspect", tmp_path / "r.npz")
    assert "registration file" in outcome.out
    assert "0.5, 0, 2 degrees about X, Y, Z" in outcome.out
    assert "made by" in outcome.out
    both = deshake("inspect", tmp_path / "c.npz", tmp_path / "r.npz", "-j", 1)
    assert [line.split("  ")[1] for line in both.out.splitlines()] == [
        "camera file",
        "registration file",
    ]


@pytest.mark.parametrize("more", [(), ("--json",)])
def test_bad_files_fail_and_the_others_continue(deshake, folder, more):
    (folder / "broken.jpg").write_bytes((folder / "sharp.jpg").read_bytes()[:900])
    (folder / "broken.npz").write_bytes(b"PK\x03\x04")
    Image.new("L", (90, 80), 100).save(folder / "flat.png")
    outcome = deshake("inspect", folder, folder / "broken.npz", "-j", 1, *more)
    assert outcome.code == 1
    for name in ("broken.jpg", "broken.npz", "flat.png"):
        assert f"error: {folder / name}: " in outcome.err
    assert "Traceback" not in outcome.err
    assert "2 done" in outcome.err
    if more:
        states = [json.loads(line)["status"] for line in outcome.out.splitlines()]
        assert sorted(states) == ["done", "done", "failed", "failed", "failed"]


def test_dry_run_names_what_it_would_inspect(deshake, folder):
    outcome = deshake("inspect", folder / "sharp.jpg", folder / "none.jpg", "--dry-run")
    assert outcome.code == 1
    assert outcome.out == f"do {folder / 'sharp.jpg'}\n"
    assert "none.jpg" in outcome.err


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ((), "FILE|DIR..."),
        (("-",), "standard input"),
        (("a.jpg", "--overwrite"), "--overwrite"),
        (("a.jpg", "-o", "b.txt"), "-o"),
        (("a.jpg", "-j", "0"), "0"),
    ],
)
def test_wrong_usage(deshake, args, words):
    outcome = deshake("inspect", *args)
    assert outcome.code == 2
    assert outcome.out == ""
    assert words in outcome.err


def test_a_folder_without_photos(deshake, tmp_path):
    outcome = deshake("inspect", tmp_path)
    assert outcome.code == 1
    assert "there are no photos in this folder" in outcome.err


def test_starts_without_the_libraries_that_only_other_commands_need(folder):
    code = (
        "import sys\nfrom deshake.cli.main import main\ncode = main(sys.argv[1:])\n"
        "assert not [name for name in sys.modules if name.startswith('scipy.')]\nsys.exit(code)"
    )
    command = [sys.executable, "-c", code, "inspect", folder / "shaken.jpg"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "shaken" in done.stdout


def test_a_damaged_photo_is_refused_in_plain_words(deshake, folder):
    path = folder / "sharp.jpg"
    path.write_bytes(path.read_bytes()[:-3000])
    outcome = deshake("inspect", path)
    assert outcome.code == 1
    assert outcome.err.splitlines() == [
        f"error: {path}: the JPEG is damaged or cut short",
        "hint: copy it again from the camera or its card, or take another copy of it",
    ]
