from __future__ import annotations

import hashlib
import json

import pytest

from deshake.geometry.camera import Camera
from deshake.io.kernel_file import CameraFile, read_kernel, write_camera

FAST = ("--blur-size", 3)
LENS = ("--focal-35mm", 40)


def test_writes_a_kernel_with_its_provenance(deshake, shaken, tmp_path):
    photo = shaken("a.jpg")
    outcome = deshake("estimate-blind", photo, *FAST, *LENS, "--json")
    assert outcome.code == 0
    content = read_kernel(tmp_path / "a.kernel.npz")
    assert content.kernel.camera.shape == (80, 100)
    report = json.loads(outcome.out)
    assert report["input"] == str(photo)
    assert report["output"] == str(tmp_path / "a.kernel.npz")
    assert report["rotations"] == len(content.kernel.weights)
    assert report["extent_px"] == pytest.approx(content.kernel.extent_px(), abs=0.01)
    assert report["confidence"] == pytest.approx(content.confidence, abs=1e-4)
    assert report["camera_source"] == "--focal-35mm 40"
    provenance = content.provenance
    assert provenance["command"] == "estimate-blind"
    assert provenance["options"] == {
        "transfer": None,
        "blur_size": 3,
        "max_angle": None,
        "region": None,
        "uniform": False,
        "estimator": "auto",
    }
    assert provenance["input_sha256"] == hashlib.sha256(photo.read_bytes()).hexdigest()
    assert provenance["camera"] == "--focal-35mm 40"
    assert provenance["notes"] == report["notes"]
    assert provenance["scales"][-1]["noise"] > 0
    assert str(tmp_path) not in json.dumps(provenance)
    for note in report["notes"]:
        assert f"warning: {photo}: {note}" in outcome.err


def test_runs_and_threads_do_not_change_a_byte(deshake, shaken, tmp_path):
    photo = shaken("a.jpg")
    found = set()
    for number, threads in enumerate((1, 1, 3)):
        out = tmp_path / f"{number}.npz"
        args = (*FAST, *LENS, "--threads", threads, "-q")
        assert deshake("estimate-blind", photo, "-o", out, *args).code == 0
        found.add(out.read_bytes())
    assert len(found) == 1


def test_a_camera_file_stands_for_the_options(deshake, shaken, tmp_path):
    photo = shaken("a.jpg")
    deshake("calibrate", photo, *LENS, "-o", tmp_path / "c.npz")
    for name, lens in (("one", LENS), ("two", ("--camera", tmp_path / "c.npz"))):
        assert deshake("estimate-blind", photo, *FAST, *lens, "-o", tmp_path / name).code == 0
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_an_assumed_lens_is_said(deshake, shaken, tmp_path):
    photo = shaken("a.jpg")
    outcome = deshake("estimate-blind", photo, *FAST)
    assert outcome.code == 0
    assert f"warning: {photo}: its metadata state no focal length; a 50 mm-equ" in outcome.err
    camera = read_kernel(tmp_path / "a.kernel.npz").kernel.camera
    assert camera.focal_px == pytest.approx(148, abs=1)


def test_a_uniform_kernel_does_not_roll(deshake, shaken, tmp_path):
    assert deshake("estimate-blind", shaken("a.jpg"), *FAST, *LENS, "--uniform").code == 0
    kernel = read_kernel(tmp_path / "a.kernel.npz").kernel
    assert kernel.camera.is_uniform
    assert abs(kernel.theta[:, 2]).max() < 1e-9


def test_a_region_shapes_the_kernel_of_the_whole_photo(deshake, shaken, tmp_path):
    assert deshake("estimate-blind", shaken("a.jpg"), *FAST, "--region", "10,5,80,60").code == 0
    content = read_kernel(tmp_path / "a.kernel.npz")
    assert content.kernel.camera.shape == (80, 100)
    assert content.provenance["options"]["region"] == [10, 5, 80, 60]


def test_an_angle_bounds_the_blur(deshake, shaken, tmp_path):
    args = (*LENS, "--max-angle", "1.5")
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
        (("--focal-px", 1), "--focal-px 1 makes a focal length"),
        (("--camera", "other.npz"), "is for pictures of 100 x 100 pixels, and"),
        (("--camera", "turned.npz"), "is for pictures of 160 x 200 pixels, and"),
        (("--camera", "none.npz"), "none.npz: no such file"),
        (("-o", "nowhere/k.npz"), "nowhere: no such folder"),
    ],
)
@pytest.mark.usefixtures("_here")
def test_what_does_not_fit_is_one_line(deshake, shaken, args, what):
    photo = shaken("a.jpg")
    write_camera("other.npz", CameraFile(Camera.from_focal(90, 100, 100), "made up"))
    write_camera("turned.npz", CameraFile(Camera.from_focal(90, 200, 160), "made up"))
    outcome = deshake("estimate-blind", photo, *args)
    assert outcome.code == 1
    [line] = [line for line in outcome.err.splitlines() if line.startswith("error: ")]
    assert what in line
    assert not photo.with_suffix(".kernel.npz").exists()


def test_json_and_standard_output_exclude_each_other(deshake, shaken):
    assert deshake("estimate-blind", shaken("a.jpg"), "-o", "-", "--json").code == 2
