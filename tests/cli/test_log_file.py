from __future__ import annotations

import logging
import re
from pathlib import Path

import pytest

TIME = r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3}"


@pytest.fixture
def log(tmp_path):
    return tmp_path / "run.log"


@pytest.fixture
def speaking(trial):
    """Install a trial command that logs at every level."""

    def function(_):
        logger = logging.getLogger("deshake.tests")
        logger.debug("a detail")
        logger.info("a note")
        logger.warning("a doubt about %s", "x\ny\x1b.jpg")
        logging.getLogger("tifffile").error("a library's fault")

    trial(function)


@pytest.mark.parametrize("loud", [("-q",), (), ("-v",), ("-vv",)])
def test_the_whole_log_is_in_the_file_whatever_is_shown(deshake, speaking, log, loud):  # noqa: ARG001
    shown = deshake("trial", *loud).err
    with_log = deshake("trial", *loud, "--log", log)
    assert re.sub(r"deshake [\d.]+: trial.*", "", with_log.err) == re.sub(
        r"deshake [\d.]+: trial.*", "", shown
    )
    lines = log.read_text("utf-8").splitlines()
    assert all(re.match(f"{TIME} [A-Z]+ |    ", line) for line in lines)
    said = [re.sub(f"^{TIME} ", "", line) for line in lines]
    assert re.fullmatch(r"DEBUG deshake\.cli\.context: deshake \S+: trial .*--log \S+", said[0])
    assert said[1:] == [
        "DEBUG deshake.tests: a detail",
        "INFO deshake.tests: a note",
        "WARNING deshake.tests: a doubt about x",
        r"    y\x1b.jpg",
        "ERROR tifffile: a library's fault",
    ]


def test_a_log_is_appended_to(deshake, speaking, log):  # noqa: ARG001
    deshake("trial", "--log", log)
    before = log.read_text("utf-8")
    deshake("--log", log, "trial")
    after = log.read_text("utf-8")
    assert after.startswith(before)
    assert after.count("a detail") == 2


def test_the_log_ends_with_the_run(deshake, speaking, log):  # noqa: ARG001
    before = list(logging.getLogger().handlers)
    deshake("trial", "--log", log)
    assert logging.getLogger().handlers == before
    size = log.stat().st_size
    deshake("trial")
    assert log.stat().st_size == size


def test_two_photos_in_processes_and_their_failures_are_in_the_log(
    deshake, shaken, pan, log, tmp_path
):
    good, gone = shaken("a.png"), tmp_path / "gone.png"
    shaken("b.png")
    out = tmp_path / "out"
    deblur = ("deblur", good, gone, "--kernel", pan, "--method", "rl", "--iterations", 2, "-o", out)
    outcome = deshake("-q", *deblur, "--log", log)
    assert outcome.code == 1
    assert outcome.err == f"error: {gone}: no such file\nhint: check the name\n"
    text = log.read_text("utf-8")
    assert f"{good}: deblurred in 2 iterations" in text  # said in another process
    assert f"ERROR deshake.cli.messages: {gone}: no such file" in text
    assert "hint: check the name" in text
    assert "    Traceback (most recent call last)" in text
    assert "2 photos: 1 done, 0 skipped, 1 failed" in text
    without = tmp_path / "without"
    without.mkdir()
    assert deshake("-q", *deblur[:-1], without).code == 1
    assert (out / "a.deshaken.png").read_bytes() == (without / "a.deshaken.png").read_bytes()


def test_the_environment_and_the_file_name_a_log(deshake, speaking, log, tmp_path, monkeypatch):  # noqa: ARG001
    config = tmp_path / "config.toml"
    config.write_text(f"log = '{log}'\n", "utf-8")
    deshake("--config", config, "trial")
    assert "a detail" in log.read_text("utf-8")
    other = tmp_path / "other.log"
    monkeypatch.setenv("DESHAKE_LOG", str(other))
    size = log.stat().st_size
    deshake("--config", config, "trial")
    assert "a detail" in other.read_text("utf-8")
    assert log.stat().st_size == size


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("none/run.log", "the log cannot be written: no such file or directory"),
        (".", "the log cannot be written: is a directory"),
        ("photo.png", "is not a log of deshake: name another file with --log"),
        ("notes.txt", "is not a log of deshake: name another file with --log"),
    ],
)
def test_a_log_that_cannot_be_written_is_wrong_usage_before_any_work(
    deshake, shaken, pan, contents, *, tmp_path, name, what
):
    photo = shaken("photo.png")
    (tmp_path / "notes.txt").write_text("my notes")
    before = contents(tmp_path)
    outcome = deshake("deblur", photo, pan, "--log", tmp_path / name)
    assert outcome.code == 2
    assert outcome.err.startswith(f"error: {tmp_path / name}: {what}\n")
    assert contents(tmp_path) == before


def test_standard_output_is_no_log(deshake, speaking):  # noqa: ARG001
    outcome = deshake("trial", "--log", "-")
    assert (outcome.code, outcome.out) == (2, "")
    assert "--log names a file" in outcome.err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_ends_the_log_and_not_the_run(deshake, speaking):  # noqa: ARG001
    outcome = deshake("trial", "-q", "-v", "--log", "/dev/full")
    assert outcome.code == 0
    assert outcome.err.count("/dev/full: the log ends here: no space left on device") == 1
    assert "warning: a doubt" in outcome.err
