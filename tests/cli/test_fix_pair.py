"""`deshake fix --noisy`: a blurred and a noisy photo of one scene."""

from __future__ import annotations

import json
import sys

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.files.kernel_file import read_kernel
from deshake.metadata.provenance import read_provenance
from deshake.pair.registration import register
from deshake.stages import deblurring, registering

pytestmark = pytest.mark.long

LENS = ("--focal-px", 150)
NEAR = (*LENS, "--search-angle", 4)  # quick: a narrow search tries few rotations
BLUR = ("--blur-size", 8)
QUIET = ("--threads", 1, "-q")


@pytest.mark.parametrize(
    ("chosen", "how"),
    [((), ()), (("--uniform",), ("--method", "residual", "--iterations", 4))],
)
def test_gives_the_bytes_of_its_stages_with_any_threads(deshake, pair, tmp_path, chosen, how):
    blurred, noisy = pair
    known, kernel, sharp = (tmp_path / name for name in ("r.npz", "k.npz", "sharp.png"))
    more = ("--registration", known, *QUIET)
    assert deshake("register", *pair, *NEAR, "-o", known, *QUIET).code == 0
    assert deshake("estimate-pair", *pair, *BLUR, *chosen, "-o", kernel, *more).code == 0
    args = ("--noisy", noisy, *how, "-o", sharp, *more)
    assert deshake("deblur", blurred, kernel, *args).code == 0
    out, kernels = tmp_path / "out.png", tmp_path / "kernels"
    args = (*NEAR, *BLUR, *chosen, *how, "-o", out, "--keep-kernels", kernels)
    outcome = deshake("fix", blurred, "--noisy", noisy, *args, "--threads", 2)
    assert (outcome.code, outcome.out) == (0, "")
    assert out.read_bytes() == sharp.read_bytes()
    assert (kernels / "blurred.kernel.npz").read_bytes() == kernel.read_bytes()
    assert read_kernel(kernel).kernel.camera.is_uniform == bool(chosen)
    assert out.read_bytes() != blurred.read_bytes()
    provenance = read_provenance(out)
    assert provenance["noisy_sha256"] == provenance["kernel"]["noisy_sha256"]


def test_it_is_sharper_and_the_report_says_all(deshake, pair, tmp_path):
    blurred, noisy = pair
    args = (*BLUR, "--uniform", "--search-angle", 4, *QUIET, "--json")
    outcome = deshake("fix", blurred, "--noisy", noisy, *args)
    assert outcome.code == 0
    report = json.loads(outcome.out)
    assert report["input"] == str(blurred)
    assert report["noisy"] == str(noisy)
    assert report["output"] == str(tmp_path / "blurred.deshaken.png")
    assert report["status"] == "done"
    assert report["scale"] == pytest.approx(4, rel=0.1)
    assert report["registration_confidence"] > 0.9
    assert any("a 50 mm-equivalent is assumed" in note for note in report["warnings"])
    assert {path.name for path in tmp_path.iterdir()} == {
        "blurred.png",
        "noisy.png",
        "blurred.deshaken.png",
    }
    before, after = (
        float(np.var(cv2.Laplacian(cv2.imread(path, 0), cv2.CV_32F)))
        for path in (str(blurred), report["output"])
    )
    assert after > 1.5 * before


def test_two_scenes_fail_and_leave_nothing(deshake, pair, tmp_path, contents):
    other = cv2.resize(data.coffee(), (140, 100), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(pair[1]), other)
    before = contents(tmp_path)
    args = ("--keep-kernels", tmp_path / "k", *NEAR)
    outcome = deshake("fix", pair[0], "--noisy", pair[1], *args)
    assert outcome.code == 1
    assert "the two photos do not show the same scene" in outcome.err
    assert "bug" not in outcome.err
    assert contents(tmp_path) == before


@pytest.mark.parametrize("name", ["noisy.png", "blurred.png"])
def test_neither_photo_is_overwritten(deshake, pair, tmp_path, contents, name):
    before = contents(tmp_path)
    args = ("-o", tmp_path / name, "--overwrite", *LENS)
    outcome = deshake("fix", pair[0], "--noisy", pair[1], *args)
    assert outcome.code == 1
    assert "the output is the input itself" in outcome.err
    assert contents(tmp_path) == before


def test_a_noisy_photo_that_is_not_there_is_named(deshake, pair, tmp_path):
    outcome = deshake("fix", pair[0], "--noisy", tmp_path / "gone.png", *LENS)
    assert outcome.code == 1
    [line] = [line for line in outcome.err.splitlines() if line.startswith("error: ")]
    assert line == f"error: {tmp_path / 'gone.png'}: no such file"


def test_skip_existing_leaves_what_is_there(deshake, pair, tmp_path):
    (tmp_path / "blurred.deshaken.png").write_text("mine")
    outcome = deshake("fix", pair[0], "--noisy", pair[1], "--skip-existing", "--json")
    assert outcome.code == 0
    assert json.loads(outcome.out)["status"] == "skipped"
    assert (tmp_path / "blurred.deshaken.png").read_text() == "mine"


@pytest.fixture
def _here(pair, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "link.png").symlink_to(pair[0])


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (
            ("blurred.png", "noisy.png", "--noisy", "noisy.png"),
            "--noisy goes with one photo: run several one by one",
        ),
        ((".", "--noisy", "noisy.png"), "--noisy goes with one photo: run several one by one"),
        (("blurred.png", "--noisy", "./blurred.png"), "is the photo itself"),
        (("blurred.png", "--noisy", "link.png"), "is the photo itself"),
        (("blurred.png", "--noisy", "noisy.png", "--region", "0,0,9,9"), "--region does not go"),
        (
            ("blurred.png", "--noisy", "noisy.png", "--estimator", "variational"),
            "--estimator does not",
        ),
        (("blurred.png", "--noisy", "noisy.png", "--method", "sparse"), "not go with --method"),
        (("blurred.png", "--method", "fusion"), "--method fusion needs --noisy"),
    ],
)
@pytest.mark.usefixtures("_here")
def test_what_does_not_go_together_is_wrong_usage(deshake, tmp_path, contents, args, what):
    before = contents(tmp_path)
    outcome = deshake("fix", *args)
    assert (outcome.code, outcome.out) == (2, "")
    assert what in outcome.err
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    "args",
    [
        ("fix", "blurred.png", "--search-angle", 5),
        ("deblur", "blurred.png", "k.npz", "--search-angle", 5),
        ("deblur", "blurred.png", "k.npz", "--noisy", "n.png", "--registration", "r.npz",
         "--search-angle", 5),
    ],
)  # fmt: skip
def test_a_search_needs_two_photos_that_are_not_registered(deshake, args):
    outcome = deshake(*args)
    assert outcome.code == 2
    assert "--search-angle" in outcome.err


@pytest.mark.parametrize(
    "option",
    [("--estimator", "edges"), ("--estimator", "variational"), ("--region", "0,0,9,9"),
     ("--focal", "auto"), ("--only-shaken",)],
)  # fmt: skip
def test_what_only_the_blind_estimate_uses_is_refused(deshake, pair, option, monkeypatch):
    blurred, noisy = pair
    outcome = deshake("fix", blurred, "--noisy", noisy, *option, "--dry-run")
    assert outcome.code == 2
    assert outcome.err.splitlines() == [
        f"error: {option[0]} does not go with --noisy: it is for photos without a noisy one.",
        "hint: see deshake fix --help",
    ]
    monkeypatch.setenv("DESHAKE_FIX_ESTIMATOR", "edges")  # gives way to what is typed
    assert deshake("fix", blurred, "--noisy", noisy, "--dry-run").code == 0


def test_all_stages_search_the_same_range(deshake, pair, tmp_path, monkeypatch):
    blurred, noisy = pair
    ranges = []

    def spy(*args, max_angle, **options):
        ranges.append(max_angle)
        return register(*args, max_angle=max_angle, **options)

    monkeypatch.setattr(registering, "register", spy)
    monkeypatch.setattr(deblurring, "register", spy)
    near = ("--search-angle", 3, "--iterations", 2, "--noisy", noisy, *QUIET)
    out, kernels = tmp_path / "near.png", tmp_path / "kernels"
    args = (*near, *LENS, *BLUR, "--uniform", "-o", out, "--keep-kernels", kernels)
    assert deshake("fix", blurred, *args).code == 0
    kernel = kernels / "blurred.kernel.npz"
    known, one = tmp_path / "r.npz", tmp_path / "one.npz"
    assert deshake("register", *pair, *LENS, *near[:2], "-o", known, *QUIET).code == 0
    args = (*BLUR, "--uniform", "--registration", known, "-o", one, *QUIET)
    assert deshake("estimate-pair", *pair, *args).code == 0
    assert one.read_bytes() == kernel.read_bytes()
    assert deshake("deblur", blurred, kernel, *near, "-o", tmp_path / "sharp.png").code == 0
    assert ranges == [pytest.approx(np.radians(3))] * 3


def test_a_result_of_other_options_is_doubted(deshake, pair):
    blurred, noisy = pair
    args = ("fix", blurred, "--noisy", noisy, *NEAR, *BLUR, "--iterations", 2, "--threads", 1)
    assert deshake(*args, "--uniform", "--skip-existing").code == 0
    again = deshake(*args, "--uniform", "--skip-existing", "--json")
    assert json.loads(again.out)["warnings"] == []
    other = deshake(*args, "--skip-existing", "--json")
    [warning] = json.loads(other.out)["warnings"]
    assert "made with other options (uniform True, now False)" in warning


@pytest.mark.skipif(sys.platform == "win32", reason="has no such permissions")
def test_a_missing_kernel_is_made_again_with_the_permissions_of_both(deshake, pair, tmp_path):
    out, kernel = tmp_path / "out.png", tmp_path / "kernels" / "blurred.kernel.npz"
    pair[0].chmod(0o664)
    pair[1].chmod(0o640)
    args = (*NEAR, *BLUR, "--uniform", "--iterations", 2, "--keep-kernels", kernel.parent, *QUIET)
    command = ("fix", pair[0], "--noisy", pair[1], "-o", out, "--skip-existing", "--json", *args)
    assert json.loads(deshake(*command).out)["status"] == "done"
    kept, made = kernel.read_bytes(), (out.stat().st_mtime_ns, out.read_bytes())
    kernel.unlink()
    assert json.loads(deshake(*command).out)["status"] == "done"
    assert kernel.read_bytes() == kept
    assert (out.stat().st_mtime_ns, out.read_bytes()) == made
    assert [path.stat().st_mode & 0o777 for path in (out, kernel)] == [0o640] * 2
