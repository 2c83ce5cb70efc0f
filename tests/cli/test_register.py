from __future__ import annotations

import hashlib
import io
import json
import subprocess
import sys

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from deshake.cli.main import main
from deshake.files.kernel_file import CameraFile, write_camera
from deshake.files.registration_file import read_registration
from deshake.geometry.camera import Camera
from deshake.geometry.rotations import homographies

pytestmark = pytest.mark.long

LENS = ("--focal-px", 240)
NARROW = ("--search-angle", 4)  # quick: a narrow search tries few rotations
NEAR = (*LENS, *NARROW)
THETA = np.radians([1.0, -2.0, 3.0])


def photo_of(name, theta=(0, 0, 0), ratio=1.0, blur=1, seed=0):
    """A photograph through a turned camera, as 8 bits of sRGB hold it: 200 x 160."""
    picture = cv2.resize(getattr(data, name)()[..., :3], (300, 240), interpolation=cv2.INTER_AREA)
    light = (picture / 255.0).astype(np.float32) ** 2.2
    camera = Camera.from_focal(240, 160, 200)
    [h] = homographies(camera, np.asarray(theta, float)[None])
    into = np.array([[1, 0, 50], [0, 1, 40], [0, 0, 1.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(light, into @ h, (200, 160), flags=flags)
    seen = cv2.blur(seen, (blur, blur))
    noise = np.random.default_rng(seed).normal(0, 0.04 if ratio > 1 else 0.003, seen.shape)
    codes = np.clip((seen + noise) / ratio, 0, 1) ** (1 / 2.2)
    return Image.fromarray(np.rint(255 * codes).astype(np.uint8))


@pytest.fixture
def pair(tmp_path):
    paths = tmp_path / "long.jpg", tmp_path / "short.png"
    photo_of("coffee", blur=5).save(paths[0], quality=94)
    photo_of("coffee", THETA, ratio=8, seed=1).save(paths[1])
    return paths


def test_writes_a_registration_with_its_provenance(deshake, pair, tmp_path):
    outcome = deshake("register", *pair, *NEAR, "--json")
    assert outcome.code == 0
    content = read_registration(tmp_path / "long.registration.npz")
    assert np.degrees(content.theta) == pytest.approx(np.degrees(THETA), abs=0.3)
    assert content.scale == pytest.approx(8, rel=0.1)
    assert content.confidence > 0.9
    assert content.camera.shape == (160, 200)
    report = json.loads(outcome.out)
    assert report["input"] == str(pair[0])
    assert report["noisy"] == str(pair[1])
    assert report["output"] == str(tmp_path / "long.registration.npz")
    assert report["theta_degrees"] == pytest.approx(np.degrees(content.theta), abs=1e-4)
    assert report["scale"] == pytest.approx(content.scale, abs=1e-4)
    assert report["confidence"] == pytest.approx(content.confidence, abs=1e-4)
    assert (report["focal_px"], report["camera_source"]) == (240, "--focal-px 240")
    provenance = content.provenance
    assert provenance["command"] == "register"
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in pair]
    assert [provenance["input_sha256"], provenance["noisy_sha256"]] == digests
    assert str(tmp_path) not in json.dumps(provenance)


def test_reports_the_registration_in_one_line(deshake, pair, tmp_path):
    outcome = deshake("register", *pair, *NEAR, "-o", tmp_path / "r.npz")
    assert outcome.code == 0
    [line] = outcome.out.splitlines()
    assert line.startswith(f"{pair[1]}: turned by ")
    assert "times darker; confidence 1.00" in line
    quiet = deshake("register", *pair, *NEAR, "-o", tmp_path / "q.npz", "-q")
    assert (quiet.code, quiet.out, quiet.err) == (0, "", "")


def test_a_camera_file_stands_for_the_options(deshake, pair, tmp_path):
    deshake("calibrate", pair[0], *LENS, "-o", tmp_path / "c.npz")
    for name, lens in (("one", LENS), ("two", ("--camera", tmp_path / "c.npz"))):
        assert deshake("register", *pair, *lens, *NARROW, "-o", tmp_path / name).code == 0
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_an_assumed_lens_is_reported(deshake, pair):
    outcome = deshake("register", *pair, *NARROW)
    assert outcome.code == 0
    assert f"warning: {pair[0]}: no focal length in its metadata; a 50 mm-equ" in outcome.err


def test_the_preview_is_a_checkerboard(deshake, pair, tmp_path):
    preview = tmp_path / "p.png"
    outcome = deshake("register", *pair, *NEAR, "--preview", preview, "--json")
    assert json.loads(outcome.out)["preview"] == str(preview)
    with Image.open(preview) as picture, Image.open(pair[0]) as blurred:
        assert picture.size == (200, 160)
        difference = np.abs(np.asarray(picture, float) - np.asarray(blurred, float)).mean(-1)
    assert difference[:20, :20].mean() < 0.5  # JPEG against PNG
    assert difference[60:80, 100:120].mean() < 0.5
    assert difference[60:80, 80:100].mean() > 2


def test_an_orientation_is_undone_and_a_turned_photo_registered(deshake, pair, tmp_path):
    with Image.open(pair[1]) as upright:
        turned = upright.transpose(Image.Transpose.ROTATE_90)
    tagged, bare = tmp_path / "tagged.png", tmp_path / "bare.png"
    exif = Image.Exif()
    exif[0x0112] = 6  # turn by 90 degrees clockwise to see it upright
    turned.save(tagged, exif=exif)
    turned.save(bare)
    angles = []
    for noisy in (tagged, bare):
        outcome = deshake("register", pair[0], noisy, *NEAR, "--json", "--overwrite")
        assert outcome.code == 0
        angles.append(json.loads(outcome.out)["theta_degrees"])
    assert angles[0] == pytest.approx(np.degrees(THETA), abs=0.3)
    assert abs(angles[1][2]) == pytest.approx(90, abs=5)


def test_another_size_is_registered(deshake, pair, tmp_path):
    with Image.open(pair[1]) as picture:
        picture.resize((400, 320), Image.Resampling.BICUBIC).save(tmp_path / "large.png")
    outcome = deshake("register", pair[0], tmp_path / "large.png", *NEAR, "--json")
    assert json.loads(outcome.out)["theta_degrees"] == pytest.approx(np.degrees(THETA), abs=0.3)


@pytest.fixture
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (("other.png",), "long.jpg, other.png: the two photos do not show the same scene"),
        (("wide.png",), "different proportions: 200 x 160 and 200 x 100 pixels"),
        (("black.png",), "one of the two photos shows nothing"),
        (("text.png",), "text.png: not a photo of a known format"),
        (("none.png",), "none.png: no such file"),
        (
            ("short.png", "--focal-px", 1),
            "a focal length of 1 pixels (--focal-px 1) cannot be right",
        ),
        (("short.png", "--camera", "c.npz"), "is for pictures of 100 x 100 pixels, and"),
        (("short.png", "--camera", "none.npz"), "none.npz: no such file"),
        (("short.png", "-o", "there.npz"), "there.npz: exists already"),
        (("short.png", "-o", "short.png"), "short.png: the output is the input itself"),
        (("short.png", "-o", "nowhere/r.npz"), "nowhere: no such folder"),
        (("short.png", "--preview", "p.gif"), "no photo format ends in '.gif'"),
        (("short.png", "--preview", "long.jpg"), "long.jpg: the output is the input itself"),
        (("short.png", "--preview", "r.npz", "-o", "r.npz"), "the output is the input itself"),
    ],
)
@pytest.mark.usefixtures("_here", "pair")
def test_what_does_not_work_is_one_line_and_leaves_nothing(deshake, contents, tmp_path, args, what):
    photo_of("astronaut", ratio=8).save("other.png")
    photo_of("coffee").crop((0, 0, 200, 100)).save("wide.png")
    Image.new("RGB", (200, 160)).save("black.png")
    (tmp_path / "text.png").write_text("not a photo, just words")
    (tmp_path / "there.npz").write_text("mine")
    write_camera("c.npz", CameraFile(Camera.from_focal(90, 100, 100), "made up"))
    before = contents(tmp_path)
    outcome = deshake("register", "long.jpg", *args)
    assert outcome.code == 1
    assert outcome.out == ""
    lines = outcome.err.splitlines()
    [line] = [line for line in lines if line.startswith("error: ")]
    assert what in line
    assert "bug" not in outcome.err
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    "args",
    [
        (),
        ("--search-angle", "0"),
        ("--search-angle", "60"),
        ("--search-angle", "wide"),
        ("--max-angle", "5"),
        ("--overwrite", "--skip-existing"),
        ("--focal-px", 100, "--focal-35mm", 35),
        ("--json", "-o", "-"),
        ("--json", "--preview", "-"),
        ("-o", "-", "--preview", "-"),
        ("third.png",),
    ],
)
def test_wrong_usage(deshake, pair, args):
    photos = pair[:1] if not args else pair
    outcome = deshake("register", *photos, *args)
    assert outcome.code == 2
    assert outcome.out == ""
    assert "error: " in outcome.err


def test_the_file_goes_to_standard_output(pair, tmp_path, capsysbinary):
    command = [sys.executable, "-m", "deshake", "register", *map(str, (*pair, *NEAR))]
    run = subprocess.run([*command, "-o", "-"], capture_output=True, check=True)
    (tmp_path / "r.npz").write_bytes(run.stdout)
    assert read_registration(tmp_path / "r.npz").confidence > 0.9
    assert sorted(path.name for path in tmp_path.iterdir()) == ["long.jpg", "r.npz", "short.png"]
    assert main([*command[3:], "--preview", "-"]) == 0
    with Image.open(io.BytesIO(capsysbinary.readouterr().out)) as picture:
        assert (picture.format, picture.size) == ("PNG", (200, 160))


def test_a_dry_run_writes_nothing(deshake, pair, tmp_path):
    outcome = deshake("register", *pair, *LENS, "--dry-run", "--json")
    assert outcome.code == 0
    report = json.loads(outcome.out)
    out = tmp_path / "long.registration.npz"
    assert report == {
        "status": "do", "input": str(pair[0]), "noisy": str(pair[1]), "output": str(out),
    }  # fmt: skip
    assert not out.exists()


def test_existing_registrations_are_skipped(deshake, pair, tmp_path):
    args = ("register", *pair, *LENS, "--skip-existing", "--json")
    assert json.loads(deshake(*args).out)["status"] == "done"
    before = (tmp_path / "long.registration.npz").stat().st_mtime_ns
    again = deshake(*args)
    assert (again.code, json.loads(again.out)["status"]) == (0, "skipped")
    assert json.loads(again.out)["warnings"] == []
    assert (tmp_path / "long.registration.npz").stat().st_mtime_ns == before
    other = json.loads(deshake(*args, "--search-angle", 5).out)
    assert "made with other options (search_angle by default, now 5" in other["warnings"][0]
    photo_of("coffee", THETA, ratio=8, seed=2).save(pair[1])
    other = json.loads(deshake(*args).out)
    assert "made with another noisy photo" in other["warnings"][0]


def test_a_failure_is_json_too(deshake, pair):
    photo_of("astronaut", ratio=8).save(pair[1])
    outcome = deshake("register", *pair, *NEAR, "--json")
    assert outcome.code == 1
    report = json.loads(outcome.out)
    assert report["status"] == "failed"
    assert "do not show the same scene" in report["error"]
    assert "--search-angle" in report["hint"]


def test_the_search_goes_as_far_as_its_angle(deshake, pair):
    photo_of("coffee", np.radians([0, 11.0, 0]), ratio=8, seed=1).save(pair[1])
    assert deshake("register", *pair, *NEAR).code == 1
    outcome = deshake("register", *pair, *LENS, "--search-angle", 12, "--json")
    assert json.loads(outcome.out)["theta_degrees"] == pytest.approx([0, 11, 0], abs=0.4)


@pytest.mark.parametrize("which", [0, 1])
def test_a_folder_is_no_photo_of_a_pair(deshake, pair, tmp_path, which):
    photos = list(pair)
    photos[which] = tmp_path
    outcome = deshake("register", *photos)
    assert outcome.code == 2
    assert f"{tmp_path} is a folder" in outcome.err


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (("none.png",), "none.png: no such file"),
        (("short.png", "-o", "none/r.npz"), "none: no such folder"),
        (("short.png", "-o", "short.png"), "short.png: the output is the input itself"),
        (("short.png", "--preview", "p.gif"), "p.gif: no photo format ends in '.gif'"),
        (("short.png", "--preview", "p"), "p: the name has no ending"),
    ],
)
@pytest.mark.usefixtures("_here", "pair")
def test_a_dry_run_and_the_run_refuse_the_same(deshake, contents, tmp_path, args, what):
    before = contents(tmp_path)
    dry = deshake("register", "long.jpg", *args, "--dry-run")
    assert (dry.code, dry.out) == (1, "")
    assert what in dry.err
    assert deshake("register", "long.jpg", *args).err == dry.err
    assert contents(tmp_path) == before


def test_a_missing_preview_is_made_again_and_the_registration_stays(deshake, pair, tmp_path):
    out, preview = tmp_path / "r.npz", tmp_path / "p.png"
    args = ("register", *pair, *NEAR, "-o", out, "--preview", preview, "--skip-existing", "--json")
    assert json.loads(deshake(*args).out)["status"] == "done"
    drawn, made = preview.read_bytes(), (out.stat().st_mtime_ns, out.read_bytes())
    preview.unlink()
    other = deshake(*args, "--search-angle", 5)  # not what made the registration
    assert json.loads(other.out)["status"] == "skipped"
    assert not preview.exists()
    assert json.loads(deshake(*args).out)["status"] == "done"
    assert preview.read_bytes() == drawn
    assert (out.stat().st_mtime_ns, out.read_bytes()) == made
    assert json.loads(deshake(*args).out)["status"] == "skipped"


@pytest.mark.skipif(sys.platform == "win32", reason="has no such permissions")
def test_outputs_take_the_permissions_that_both_photos_have(deshake, pair, tmp_path):
    out, preview = tmp_path / "r.npz", tmp_path / "p.png"
    pair[0].chmod(0o664)
    pair[1].chmod(0o640)
    assert deshake("register", *pair, *NEAR, "-o", out, "--preview", preview).code == 0
    assert [path.stat().st_mode & 0o777 for path in (out, preview)] == [0o640] * 2
