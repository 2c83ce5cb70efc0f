from __future__ import annotations

import logging

import pytest

from deshake.cli.messages import describe, log_to_stderr, print_error, set_verbosity
from deshake.errors import PhotoError

LOG = logging.getLogger("deshake.tests")


def say_everything():
    LOG.debug("a detail")
    LOG.info("a note")
    LOG.warning("a doubt")
    LOG.error("a fault")
    logging.getLogger("tifffile").error("a library's fault")


@pytest.mark.parametrize(
    ("verbosity", "lines"),
    [
        (-2, ["error: a fault"]),
        (-1, ["error: a fault"]),
        (0, ["warning: a doubt", "error: a fault"]),
        (1, ["a note", "warning: a doubt", "error: a fault"]),
        (
            2,
            [
                "debug: deshake.tests: a detail",
                "a note",
                "warning: a doubt",
                "error: a fault",
                "error: a library's fault",
            ],
        ),
    ],
)
def test_verbosity(capsys, verbosity, lines):
    with log_to_stderr():
        set_verbosity(verbosity)
        say_everything()
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == lines


def test_logging_is_left_as_it_was(capsys):
    root = logging.getLogger()
    before = list(root.handlers), root.level, logging.getLogger("deshake").level
    with log_to_stderr():
        set_verbosity(2)
    assert before == (list(root.handlers), root.level, logging.getLogger("deshake").level)
    assert capsys.readouterr().err == ""


def test_messages_stay_on_one_line(capsys):
    print_error("bad\nname\x1b[31m.jpg: no such file", hint="look\tagain")
    assert capsys.readouterr().err == (
        "error: bad\\nname\\x1b[31m.jpg: no such file\nhint: look\\tagain\n"
    )


def test_colour_is_for_terminals_and_obeys_no_color(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.delenv("NO_COLOR", raising=False)
    print_error("torn")
    assert "\x1b[" in capsys.readouterr().err
    monkeypatch.setenv("NO_COLOR", "1")
    print_error("torn")
    assert capsys.readouterr().err == "error: torn\n"


def test_a_log_line_passes_above_a_progress_bar(capsys):
    from deshake.cli.context import ProgressBar  # noqa: PLC0415  tqdm is imported with the bar

    with log_to_stderr(), ProgressBar("working", shown=True) as bar:
        bar(0.5)
        LOG.warning("a doubt")
    assert "\rwarning: a doubt\n" in capsys.readouterr().err.replace("\x1b[K", "").replace(" ", " ")


@pytest.mark.parametrize(
    ("error", "message", "hint"),
    [
        (PhotoError("is torn", hint="glue it", file="a.jpg"), "a.jpg: is torn", "glue it"),
        (MemoryError(), "not enough memory", "try a smaller photo, or close other programs"),
        (OSError(28, "No space left", "out.png"), "out.png: No space left", None),
        (
            KeyError("k"),
            "KeyError: 'k'",
            "this is a bug in deshake: report it with what -vv prints",
        ),
    ],
)
def test_every_error_is_printed_in_a_line(error, message, hint):
    assert describe(error) == (message, hint)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("--camera", None),
        ("--overwrit", "--overwrite"),
        ("--skip-exsting", "--skip-existing"),
        ("--jobz", "--jobs"),
        ("--colour", None),
    ],
)
def test_only_what_may_have_been_meant_is_suggested(deshake, typed, meant):
    outcome = deshake("calibrate", "a.jpg", typed, "x")
    assert outcome.code == 2
    guess = "" if meant is None else f" Did you mean '{meant}'?"
    assert outcome.err.splitlines()[0] == f"error: No such option '{typed}'.{guess}"
