from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest
from PIL import Image

from deshake.files.kernel_file import read_kernel
from deshake.metadata.provenance import read_provenance

pytestmark = pytest.mark.long

LENS = ("--focal-35mm", 40)
EDGES = ("--estimator", "edges")
FAST = (*LENS, *EDGES, "--uniform", "--blur-size", 3, "--region", "20,10,60,50", "--iterations", 2)


def test_gives_the_bytes_of_its_stages_with_any_threads(deshake, shaken, tmp_path):
    photo = shaken("a.jpg", large=True, size=(140, 112))
    camera, kernel, sharp = tmp_path / "c.npz", tmp_path / "k.npz", tmp_path / "sharp.jpg"
    assert deshake("calibrate", photo, "--focal-35mm", 40, "-o", camera).code == 0
    how = ("--blur-size", 9, "--region", "16,6,104,100")
    args = ("--camera", camera, *how, "-o", kernel, "-q", "--threads", 1)
    assert deshake("estimate-blind", photo, *args).code == 0
    assert deshake("deblur", photo, kernel, "-o", sharp, "--threads", 1).code == 0
    fixed, kernels = tmp_path / "fixed.jpg", tmp_path / "kernels"
    args = (*LENS, *how, "--keep-kernels", kernels, "--threads", 3)
    outcome = deshake("fix", photo, "-o", fixed, *args)
    assert outcome.code == 0
    assert outcome.out == ""
    assert fixed.read_bytes() == sharp.read_bytes()
    assert (kernels / "a.kernel.npz").read_bytes() == kernel.read_bytes()
    assert read_kernel(kernel).kernel.extent_px() > 5
    assert fixed.read_bytes() != photo.read_bytes()


def test_the_method_is_that_of_deblur(deshake, shaken, tmp_path):
    photo, kernels, out = shaken("a.png"), tmp_path / "k", tmp_path / "out.png"
    args = (*FAST, "--method", "rl")
    assert deshake("fix", photo, "--keep-kernels", kernels, *args).code == 0
    args = ("--method", "rl", "--iterations", 2, "-o", out)
    assert deshake("deblur", photo, kernels / "a.kernel.npz", *args).code == 0
    assert out.read_bytes() == (tmp_path / "a.deshaken.png").read_bytes()


def test_the_photo_has_the_provenance_of_its_kernel_or_none(deshake, shaken, sharp_photo, tmp_path):
    photo, out = shaken("a.jpg"), tmp_path / "a.deshaken.jpg"
    assert deshake("fix", photo, *FAST).code == 0
    provenance = read_provenance(out)["kernel"]
    assert provenance["command"] == "estimate-blind"
    assert provenance["camera"] == "--focal-35mm 40"
    assert provenance["options"]["region"] == [20, 10, 60, 50]
    photo = sharp_photo("a.jpg")
    assert deshake("fix", photo, *FAST, "--overwrite", "--no-provenance").code == 0
    assert b"deshake" not in out.read_bytes()


def test_fixes_beside_the_photo_and_keeps_it(deshake, sharp_photo, tmp_path):
    photo = sharp_photo("a.jpg")
    before = photo.read_bytes(), photo.stat().st_mtime_ns
    outcome = deshake("fix", photo, *FAST, "--json")
    assert outcome.code == 0
    report = json.loads(outcome.out)
    assert report["status"] == "done"
    assert report["output"] == str(tmp_path / "a.deshaken.jpg")
    assert report["camera_source"] == "--focal-35mm 40"
    assert {path.name for path in tmp_path.iterdir()} == {"a.jpg", "a.deshaken.jpg"}
    assert (photo.read_bytes(), photo.stat().st_mtime_ns) == before


def test_a_folder_and_a_photo_go_to_a_folder(deshake, sharp_photo, tmp_path):
    folder = tmp_path / "in"
    (folder / "below").mkdir(parents=True)
    one = sharp_photo("one.jpg").rename(folder / "one.jpg")
    for name in ("old.deshaken.jpg", ".hidden.jpg", "below/deep.jpg", "text.txt"):
        shutil.copy(one, folder / name)
    two = sharp_photo("two.PNG")
    out = tmp_path / "out"
    outcome = deshake("fix", folder, two, "-o", out, "--keep-kernels", tmp_path / "k", *FAST)
    assert (outcome.code, outcome.out) == (0, "")
    assert {path.name for path in out.iterdir()} == {"one.deshaken.jpg", "two.deshaken.PNG"}
    names = {path.name for path in (tmp_path / "k").iterdir()}
    assert names == {"one.kernel.npz", "two.kernel.npz"}
    kernel = read_kernel(tmp_path / "k" / "one.kernel.npz")
    assert kernel.kernel.camera.shape == (80, 100)


def test_one_bad_photo_does_not_stop_the_rest(deshake, sharp_photo, tmp_path):
    bad, empty = tmp_path / "bad.jpg", tmp_path / "empty.jpg"
    bad.write_text("not a photo")
    empty.touch()
    good = sharp_photo("good.jpg")
    outcome = deshake("fix", bad, good, empty, "--json", *FAST)
    assert outcome.code == 1
    lines = [json.loads(line) for line in outcome.out.splitlines()]
    lines.sort(key=lambda line: [str(bad), str(good), str(empty)].index(line["input"]))
    assert [line["status"] for line in lines] == ["failed", "done", "failed"]
    assert "not a photo" in lines[0]["error"]
    assert f"error: {bad}: not a photo" in outcome.err
    assert f"error: {empty}: the file is empty" in outcome.err
    assert (
        "\n3 photos: 0 done, 1 left as it is, 0 skipped, 2 failed; 1 with warnings; 0:0"
        in outcome.err
    )
    assert f"\n  failed: {bad}\n" in outcome.err
    assert (tmp_path / "good.deshaken.jpg").exists()


def test_fail_fast_stops_at_the_first(deshake, sharp_photo, tmp_path):
    bad = tmp_path / "bad.jpg"
    bad.touch()
    args = ("--fail-fast", "--json", "-j", 1)
    outcome = deshake("fix", bad, sharp_photo("good.jpg"), *args, *FAST)
    assert outcome.code == 1
    assert len(outcome.out.splitlines()) == 1
    assert "2 photos: 0 done, 0 skipped, 1 failed, 1 not begun" in outcome.err
    assert not (tmp_path / "good.deshaken.jpg").exists()


def test_existing_outputs_are_refused_before_any_work(deshake, sharp_photo, tmp_path):
    one, two = sharp_photo("one.jpg"), sharp_photo("two.jpg")
    out = tmp_path / "one.deshaken.jpg"
    out.write_text("mine")
    outcome = deshake("fix", one, two, *FAST)
    assert outcome.code == 1
    assert f"error: {out}: exists already\nhint: " in outcome.err
    assert out.read_text() == "mine"
    assert (tmp_path / "two.deshaken.jpg").exists()
    assert deshake("fix", one, "--overwrite", *FAST).code == 0
    assert out.read_bytes() == (tmp_path / "two.deshaken.jpg").read_bytes()


def test_skip_existing_leaves_what_is_there(deshake, sharp_photo, tmp_path):
    one, two = sharp_photo("one.jpg"), sharp_photo("two.jpg")
    out, kernels = tmp_path / "one.deshaken.jpg", tmp_path / "k"
    out.write_text("mine")
    kernels.mkdir()
    (kernels / "two.kernel.npz").write_text("of an earlier run that was cut short")
    args = ("--skip-existing", "--keep-kernels", kernels, "--json", *FAST)
    outcome = deshake("fix", one, two, *args)
    assert outcome.code == 0
    assert {json.loads(line)["status"] for line in outcome.out.splitlines()} == {"skipped", "done"}
    assert out.read_text() == "mine"
    assert read_kernel(kernels / "two.kernel.npz").confidence >= 0
    assert deshake("fix", one, "--skip-existing", "--overwrite").code == 2


@pytest.mark.parametrize("case", ["twice", "link", "kernels", "same name"])
def test_two_results_of_one_name_are_wrong_usage(deshake, shaken, tmp_path, case):
    one, other = shaken("one.jpg"), tmp_path / "other"
    other.mkdir()
    args = {
        "twice": (one, one),
        "link": (one, other / "up" / "one.jpg"),
        "kernels": (one, shaken("one.png"), "--keep-kernels", other),
        "same name": (one, shutil.copy(one, other / "one.jpg"), "-o", tmp_path / "out"),
    }[case]
    (other / "up").symlink_to(tmp_path)
    outcome = deshake("fix", *args)
    assert outcome.code == 2
    assert "would both be written to" in outcome.err
    assert not list(tmp_path.glob("*.deshaken.*"))
    assert not (tmp_path / "out").exists()


def test_several_photos_do_not_go_to_one_file(deshake, shaken, tmp_path):
    (tmp_path / "out.jpg").touch()
    outcome = deshake("fix", shaken("a.jpg"), shaken("b.jpg"), "-o", tmp_path / "out.jpg")
    assert outcome.code == 2
    assert "for several photos, -o names a folder" in outcome.err
    assert (tmp_path / "out.jpg").read_bytes() == b""


def test_a_slash_names_a_folder_for_one_photo(deshake, sharp_photo, tmp_path):
    photo, out = sharp_photo("one.jpg"), tmp_path / "out.png"
    planned = deshake("fix", photo, "-o", f"{out}/", "--dry-run")
    assert planned.out == f"do {photo} -> {out / 'one.deshaken.jpg'}\n"
    assert not out.exists()
    outcome = deshake("fix", photo, "-o", f"{out}/", "--format", "jpeg", *FAST)
    assert outcome.code == 0
    assert [path.name for path in out.iterdir()] == ["one.deshaken.jpg"]
    outcome = deshake("fix", photo, "-o", f"{photo}/", *FAST)
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {photo}: is not a folder")


def test_only_the_last_folder_is_made(deshake, shaken, tmp_path):
    out = tmp_path / "new" / "out"
    outcome = deshake("fix", shaken("a.jpg"), shaken("b.jpg"), "-o", out)
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {out}: the folder cannot be made: no such file")
    assert not (tmp_path / "new").exists()


def test_a_result_is_never_another_input(deshake, sharp_photo, tmp_path):
    one = sharp_photo("one.jpg")
    before = sharp_photo("one.deshaken.jpg").read_bytes()
    outcome = deshake("fix", one, tmp_path / "one.deshaken.jpg", "--overwrite", *FAST)
    assert outcome.code == 1
    assert f"error: {tmp_path / 'one.deshaken.jpg'}: the output is the input itself" in outcome.err
    assert (tmp_path / "one.deshaken.jpg").read_bytes() == before
    assert (tmp_path / "one.deshaken.deshaken.jpg").exists()


def test_a_folder_without_photos_is_an_error(deshake, tmp_path):
    outcome = deshake("fix", tmp_path)
    assert outcome.code == 1
    assert outcome.err.startswith(f"error: {tmp_path}: there are no photos in this folder\nhint: ")


def test_no_photo_is_wrong_usage(deshake):
    assert deshake("fix").code == 2


def test_the_progress_bar_shows_the_photo_and_the_time_left(deshake, shaken):
    outcome = deshake("fix", shaken("a.jpg"), *LENS, *EDGES, "--iterations", 2, "--progress")
    assert outcome.code == 0
    # the bar is drawn now and then: of two quick steps one may not be shown
    assert re.search(r"a\.jpg: (starts|refinement) +\d", outcome.err)
    assert " left" in outcome.err


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
def test_an_interrupt_leaves_nothing(shaken, tmp_path):
    photo = shaken("a.jpg")
    with Image.open(photo) as image:
        image.resize((400, 320)).save(photo)
    args = ["fix", photo, "--keep-kernels", tmp_path / "k", "-v", "--progress"]
    process = subprocess.Popen(
        [sys.executable, "-m", "deshake", *map(str, args)], stderr=subprocess.PIPE
    )
    os.set_blocking(process.stderr.fileno(), False)
    heard, deadline = b"", time.monotonic() + 60
    while b"starts" not in heard and time.monotonic() < deadline:
        heard += process.stderr.read() or b""
        time.sleep(0.02)
    assert b"starts" in heard
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 130
    process.stderr.close()
    assert {path.name for path in tmp_path.iterdir()} == {"a.jpg", "k"}
    assert list((tmp_path / "k").iterdir()) == []
