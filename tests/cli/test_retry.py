from __future__ import annotations

import json

import click
import pytest

from deshake.cli.retry import failed_before


@pytest.fixture
def printed(tmp_path):
    """Write what --json printed."""

    def write(*lines):
        path = tmp_path / "run.jsonl"
        text = "".join((x if isinstance(x, str) else json.dumps(x)) + "\n" for x in lines)
        path.write_text(text, "utf-8")
        return path

    return write


def line(name, status="failed"):
    return {"status": status, "input": str(name)}


def test_the_last_line_of_a_photo_counts(printed):
    path = printed(
        line("a"), line("b"), "", line("c", "done"), line("a", "done"), line("c"), line("d", "skip")
    )
    assert failed_before(path) == ["b", "c"]


@pytest.mark.parametrize(
    "bad",
    [
        *("torn", '{"status": "failed"', "[]", "3", '"failed"', "null", "{}", "[" * 3000),
        *('{"status": "failed"}', '{"input": "a"}', '{"status": 1, "input": "a"}'),
        *('{"status": "failed", "input": ["a"]}', "9" * 5000),
    ],
)
def test_a_malformed_line_is_wrong_usage_with_its_number(printed, bad):
    path = printed(line("a"), "", bad, line("b"))
    with pytest.raises(click.UsageError) as error:
        failed_before(path)
    assert error.value.message == f"{path}: line 3 is not a line that --json prints"


@pytest.fixture
def tree(shaken, tmp_path):
    """A folder of photos, two of which are torn, in two levels."""
    folder = tmp_path / "in"
    (folder / "day").mkdir(parents=True)
    for name in ("a.png", "day/b.png", "day/c.png"):
        (folder / name).write_bytes(shaken("x.png").read_bytes())
    for name in ("torn.png", "day/torn.png"):
        (folder / name).write_bytes(b"torn")
    return folder


def test_only_the_photos_that_failed_are_repeated_under_the_same_names(
    deshake, tree, pan, shaken, contents, *, tmp_path
):
    out, report = tmp_path / "out", tmp_path / "run.jsonl"
    run = ("deblur", tree, "-r", "--kernel", pan, "-o", out, "--method", "rl", "--iterations", 2)
    first = deshake(*run, "--json")
    assert first.code == 1
    report.write_text(first.out, "utf-8")
    before = contents(out)
    assert len(before) == 3
    (tree / "day/torn.png").write_bytes(shaken("x.png").read_bytes())  # mended
    again = deshake(*run, "--json", "--retry-failed", report)
    assert again.code == 1
    results = {each["input"]: each for each in map(json.loads, again.out.splitlines())}
    assert set(results) == {str(tree / "torn.png"), str(tree / "day/torn.png")}
    mended = results[str(tree / "day/torn.png")]
    assert mended["status"] == "done"
    assert mended["output"] == str(out / "day" / "torn.deshaken.png")
    old = {each["input"]: each["output"] for each in map(json.loads, first.out.splitlines())}
    assert {name: each["output"] for name, each in results.items()}.items() <= old.items()
    after = contents(out)
    assert after.items() >= before.items()
    assert len(after) == 4
    assert "2 photos: 1 done, 0 skipped, 1 failed" in again.err


def test_the_words_where_nothing_failed(deshake, shaken, pan, printed, contents, *, tmp_path):
    photo = shaken("a.png")
    path = printed(line(photo, "done"))
    before = contents(tmp_path)
    outcome = deshake("deblur", photo, pan, "--retry-failed", path)
    assert (outcome.code, outcome.out) == (0, "")
    assert outcome.err == f"{path}: no photo failed: there is nothing to repeat\n"
    assert contents(tmp_path) == before


def test_a_failed_photo_that_is_not_given_gives_a_warning(deshake, shaken, pan, printed):
    photo = shaken("a.png")
    path = printed(line(photo), line("elsewhere.png"))
    words = ("deblur", photo, pan, "--method", "rl", "--iterations", 2, "--retry-failed", path)
    outcome = deshake(*words)
    assert outcome.code == 0
    assert f"warning: elsewhere.png: failed in {path}, and is not among the photos" in outcome.err
    assert photo.with_name("a.deshaken.png").exists()


@pytest.mark.parametrize(
    ("lines", "what"),
    [
        (["torn"], "line 1 is not a line that --json prints"),
        ([], "is empty; if this run's --json goes there, let it go to another file"),
        ([line("elsewhere.png")], "none of the photos that failed, such as elsewhere.png, is"),
        (None, "no such file"),
    ],
)
def test_a_wrong_file_is_wrong_usage(deshake, shaken, pan, printed, *, tmp_path, lines, what):
    photo = shaken("a.png")
    path = tmp_path / "none.jsonl" if lines is None else printed(*lines)
    outcome = deshake("deblur", photo, pan, "--retry-failed", path)
    assert outcome.code == 2
    assert f"error: {path}: {what}" in outcome.err
    assert not photo.with_name("a.deshaken.png").exists()


def test_a_photo_is_no_report(deshake, shaken, pan):
    photo = shaken("a.png")
    outcome = deshake("deblur", photo, pan, "--retry-failed", photo)
    assert outcome.code == 2
    assert f"error: {photo}: not a text file" in outcome.err


def test_a_name_that_is_no_utf8_is_recognised(deshake, shaken, pan, printed, tmp_path):
    source = shaken("a.png")
    photo = tmp_path / "b\udcff.png"
    try:
        source.rename(photo)
    except (OSError, UnicodeError):
        pytest.skip("the file system wants UTF-8")
    path = printed(line("b\ufffd.png"), line(tmp_path / "b\ufffd.png"))
    words = ("deblur", photo, pan, "--method", "rl", "--iterations", 2, "--retry-failed", path)
    assert deshake(*words).code == 0
    assert photo.with_name("b\udcff.deshaken.png").exists()


def test_chessboards_are_not_repeated(deshake, shaken, printed):
    outcome = deshake(
        "calibrate", shaken("a.png"), "--chessboard", "-o", "c.npz", "--retry-failed", printed("x")
    )
    assert outcome.code == 2
    assert "--chessboard and --retry-failed cannot both be given" in outcome.err
