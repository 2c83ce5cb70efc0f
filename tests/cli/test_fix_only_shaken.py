from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

FAST = ("--blur-size", 8, "--iterations", 2, "--uniform", "--region", "40,30,90,80", "-j", 1)


@pytest.fixture
def folder(tmp_path, sharp, shaken):
    """A photo that is sharp and one that is shaken."""
    (tmp_path / "in").mkdir()
    codes = np.rint(255 * np.clip(sharp, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "in" / "still.png")
    shaken("moved.png", large=True).rename(tmp_path / "in" / "moved.png")
    return tmp_path / "in"


def test_passes_over_what_is_not_shaken(deshake, folder, tmp_path):
    out, page = tmp_path / "out", tmp_path / "report.html"
    outcome = deshake("fix", folder, "-o", out, "--only-shaken", "--report", page, "--json", *FAST)
    assert outcome.code == 0
    reports = {report["input"]: report for report in map(json.loads, outcome.out.splitlines())}
    still, moved = (reports[str(folder / name)] for name in ("still.png", "moved.png"))
    assert (still["status"], still["verdict"], still["reason"]) == ("skipped", "unshaken", "sharp")
    assert moved["status"] == "done"
    assert [path.name for path in out.iterdir()] == ["moved.deshaken.png"]
    assert f"{folder / 'still.png'}: passed over: sharp\n" in outcome.err
    assert f"{folder / 'moved.png'} -> {out / 'moved.deshaken.png'}: " in outcome.err
    assert "1 not shaken, 0 skipped, 0 failed" in outcome.err
    text = page.read_text("utf-8")
    assert "1 not shaken" in text
    assert ">Not shaken</span>" in text
    assert "--only-shaken" not in text.partition("still.png</h2>")[2]


def test_the_result_is_that_without_the_option(deshake, folder, tmp_path):
    photo, one, two = folder / "moved.png", tmp_path / "one.png", tmp_path / "two.png"
    assert deshake("fix", photo, "-o", one, *FAST).code == 0
    assert deshake("fix", photo, "-o", two, "--only-shaken", *FAST).code == 0
    assert one.read_bytes() == two.read_bytes()
    # What exists already is skipped as always.
    outcome = deshake("fix", photo, "-o", two, "--only-shaken", "--skip-existing", "--json", *FAST)
    report = json.loads(outcome.out)
    assert (report["status"], "verdict" in report) == ("skipped", False)


def test_one_photo_that_is_not_shaken_is_no_failure(deshake, folder):
    outcome = deshake("fix", folder / "still.png", "--only-shaken")
    assert (outcome.code, outcome.out) == (0, "")
    assert outcome.err == f"{folder / 'still.png'}: passed over: sharp\n"
    assert deshake("fix", folder / "still.png", "--only-shaken", "-q").err == ""
    assert not (folder / "still.deshaken.png").exists()


@pytest.mark.parametrize("as_json", [False, True])
def test_a_dry_run_says_what_is_passed_over(deshake, folder, tmp_path, as_json, contents):
    (folder / "broken.png").write_bytes((folder / "still.png").read_bytes()[:99])
    before = contents(tmp_path)
    more = ("--json",) if as_json else ()
    outcome = deshake("fix", folder, "-o", tmp_path / "out", "--only-shaken", "--dry-run", *more)
    assert outcome.code == 1
    assert f"error: {folder / 'broken.png'}: " in outcome.err
    if as_json:
        reports = [json.loads(line) for line in outcome.out.splitlines()]
        states = {report["input"].rpartition("/")[2]: report["status"] for report in reports}
        assert states == {"broken.png": "failed", "moved.png": "do", "still.png": "skip"}
        assert reports[2]["reason"] == "sharp"
    else:
        moved = tmp_path / "out" / "moved.deshaken.png"
        assert outcome.out.splitlines() == [
            f"do {folder / 'moved.png'} -> {moved}",
            f"skip {folder / 'still.png'}: sharp",
        ]
    assert contents(tmp_path) == before


def test_goes_with_one_photo_alone_not_with_a_pair(deshake, pair):
    outcome = deshake("fix", pair[0], "--noisy", pair[1], "--only-shaken")
    assert outcome.code == 2
    assert "--only-shaken does not go with --noisy" in outcome.err
