from __future__ import annotations

import json
import subprocess
import sys

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.files.kernel_file import CameraFile, read_kernel, write_camera
from deshake.files.registration_file import RegistrationFile, write_registration
from deshake.geometry.camera import Camera
from deshake.geometry.rotations import grid_steps

SHAPE = (100, 140)
CAMERA = Camera.from_focal(150.0, *SHAPE)
STEPS = grid_steps(CAMERA)
FAST = ("--focal-px", 150, "--blur-size", 8, "--threads", 1)
FASTER = (*FAST, "--search-angle", 4)  # a narrow search tries few rotations


def test_writes_a_kernel_and_reports_it(deshake, pair, tmp_path):
    outcome = deshake("estimate-pair", *pair, *FAST, "--transfer", "gamma22", "--json")
    assert outcome.code == 0, outcome.err
    content = read_kernel(tmp_path / "blurred.kernel.npz")
    kernel = content.kernel
    report = json.loads(outcome.out)
    assert report["input"] == str(pair[0])
    assert report["noisy"] == str(pair[1])
    assert report["output"] == str(tmp_path / "blurred.kernel.npz")
    assert report["rotations"] == len(kernel.weights)
    assert report["scale"] == pytest.approx(4, rel=0.05)
    assert report["confidence"] == pytest.approx(content.confidence, abs=1e-4)
    assert content.confidence > 0.8
    spread = np.sqrt(kernel.weights @ (kernel.centred().theta / STEPS) ** 2)
    np.testing.assert_allclose(spread, [0, 5 / np.sqrt(12), 0], atol=0.5)


def test_a_registration_brings_its_camera(deshake, pair, tmp_path):
    file = tmp_path / "r.npz"
    content = RegistrationFile(np.array([2, -2, 1]) * STEPS, 4.0, CAMERA, 0.9)
    write_registration(file, content)
    args = (*pair, "--registration", file, "--blur-size", 8, "--json")
    outcome = deshake("estimate-pair", *args)
    assert outcome.code == 0, outcome.err
    report = json.loads(outcome.out)
    assert report["camera_source"] == "the registration"
    assert report["focal_px"] == 150
    assert report["registration_confidence"] == 0.9


@pytest.mark.parametrize(
    "option", [("--focal-px", 150), ("--focal-35mm", 40), ("--camera", "c"), ("--search-angle", 5)]
)
def test_a_registration_and_a_camera_exclude_each_other(deshake, pair, tmp_path, option):
    outcome = deshake("estimate-pair", *pair, "--registration", tmp_path / "r.npz", *option)
    assert outcome.code == 2
    assert f"--registration and {option[0]} cannot both be given" in outcome.err


@pytest.fixture
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (("--blur-size", 90), "a blur of 90 px does not fit"),
        (("--registration", "none.npz"), "none.npz: no such file"),
        (("--registration", "blurred.png"), "no usable registration file"),
        (("--camera", "other.npz"), "is for pictures of 90 x 100 pixels"),
        (("-o", "nowhere/k.npz"), "nowhere: no such folder"),
        (("-o", "noisy.png"), "the output is the input itself"),
        (("-o", "blurred.png", "--overwrite"), "the output is the input itself"),
    ],
)
@pytest.mark.usefixtures("_here")
def test_what_does_not_fit_is_one_line(deshake, pair, tmp_path, args, what):
    write_camera("other.npz", CameraFile(Camera.from_focal(90, 100, 90), "made up"))
    before = sorted(tmp_path.iterdir())
    outcome = deshake("estimate-pair", *pair, *args)
    assert outcome.code == 1
    [line] = [line for line in outcome.err.splitlines() if line.startswith("error: ")]
    assert what in line
    assert "bug" not in outcome.err
    assert sorted(tmp_path.iterdir()) == before


def test_an_existing_kernel_is_kept(deshake, pair, tmp_path):
    (tmp_path / "blurred.kernel.npz").write_text("mine")
    assert deshake("estimate-pair", *pair, *FAST).code == 1
    assert (tmp_path / "blurred.kernel.npz").read_text() == "mine"
    assert deshake("estimate-pair", *pair, *FASTER, "--overwrite").code == 0


@pytest.mark.parametrize("which", [0, 1])
def test_a_photo_that_is_not_there_is_named(deshake, pair, tmp_path, which):
    pair[which] = tmp_path / "gone.png"
    outcome = deshake("estimate-pair", *pair, *FAST)
    assert outcome.code == 1
    assert f"{tmp_path / 'gone.png'}: no such file" in outcome.err


def test_photos_of_two_scenes_fail(deshake, pair, tmp_path):
    other = cv2.resize(data.coffee(), SHAPE[::-1], interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(tmp_path / "other.png"), other)
    outcome = deshake("estimate-pair", pair[0], tmp_path / "other.png", *FASTER)
    assert outcome.code == 1
    assert "the two photos do not show the same scene" in outcome.err
    assert not (tmp_path / "blurred.kernel.npz").exists()


def test_json_and_standard_output_exclude_each_other(deshake, pair):
    outcome = deshake("estimate-pair", *pair, "-o", "-", "--json")
    assert outcome.code == 2
    assert outcome.out == ""


def test_a_uniform_kernel_does_not_roll_and_goes_to_standard_output(pair, tmp_path):
    args = (*pair, *FASTER, "--uniform", "-o", "-", "-q")
    command = [sys.executable, "-m", "deshake", "estimate-pair", *map(str, args)]
    done = subprocess.run(command, capture_output=True, check=True)
    (tmp_path / "k.npz").write_bytes(done.stdout)
    kernel = read_kernel(tmp_path / "k.npz").kernel
    assert kernel.camera.is_uniform
    assert np.all(kernel.theta[:, 2] == 0)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "blurred.png",
        "k.npz",
        "noisy.png",
    ]


def test_two_photos_are_needed(deshake, pair):
    outcome = deshake("estimate-pair", pair[0])
    assert outcome.code == 2
    assert "NOISY" in outcome.err


def test_dry_run_json_and_skip_existing_work_as_in_all_commands(deshake, pair, tmp_path):
    args = ("estimate-pair", *pair, *FASTER, "--json")
    out = tmp_path / "blurred.kernel.npz"
    dry = deshake(*args, "--dry-run")
    assert (dry.code, json.loads(dry.out)["status"]) == (0, "do")
    assert not out.exists()
    done = json.loads(deshake(*args).out)
    assert done["status"] == "done"
    assert "notes" not in done
    skipped = json.loads(deshake(*args, "--skip-existing").out)
    assert (skipped["status"], skipped["warnings"]) == ("skipped", [])
    other = json.loads(deshake(*args, "--skip-existing", "--uniform").out)
    assert "made with other options (uniform False, now True)" in other["warnings"][0]
    failed = deshake(*args)
    assert (failed.code, json.loads(failed.out)["status"]) == (1, "failed")
    assert "exists already" in json.loads(failed.out)["error"]


def test_a_search_angle_is_in_the_provenance(deshake, pair, tmp_path):
    assert deshake("estimate-pair", *pair, *FAST, "--search-angle", 5).code == 0
    provenance = read_kernel(tmp_path / "blurred.kernel.npz").provenance
    assert provenance["options"]["search_angle"] == 5


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (("--registration", "none.npz"), "none.npz: no such file"),
        (("--registration", "text.npz"), "text.npz: no usable registration file"),
        (("-o", "none/k.npz"), "none: no such folder"),
    ],
)
@pytest.mark.usefixtures("_here")
def test_a_dry_run_and_the_run_refuse_the_same(deshake, pair, contents, args, what):
    folder = pair[0].parent
    (folder / "text.npz").write_text("no registration")
    before = contents(folder)
    dry = deshake("estimate-pair", *pair, *args, "--dry-run")
    assert (dry.code, dry.out) == (1, "")
    assert what in dry.err
    assert deshake("estimate-pair", *pair, *args).err == dry.err
    assert contents(folder) == before


@pytest.mark.parametrize("which", [0, 1])
def test_a_dry_run_reports_a_missing_photo(deshake, pair, which):
    pair[which].unlink()
    dry = deshake("estimate-pair", *pair, "--dry-run")
    assert (dry.code, dry.out) == (1, "")
    assert f"{pair[which]}: no such file" in dry.err


@pytest.mark.skipif(sys.platform == "win32", reason="has no such permissions")
def test_a_kernel_takes_the_permissions_that_both_photos_have(deshake, pair, tmp_path):
    pair[0].chmod(0o640)
    pair[1].chmod(0o604)
    assert deshake("estimate-pair", *pair, *FASTER).code == 0
    assert (tmp_path / "blurred.kernel.npz").stat().st_mode & 0o777 == 0o600
