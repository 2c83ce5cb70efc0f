from __future__ import annotations

import os
import re
import struct
import subprocess
import sys

import pytest

from deshake.cli.context import Context, ProgressBar


def test_a_bar_shows_nothing_unless_wanted(capsys):
    for context in (Context(progress=False), Context(progress=True, verbosity=-1)):
        with context.bar("working") as bar:
            bar(0.5)
    assert capsys.readouterr().err == ""


def test_stderr_is_no_terminal_here():
    assert not Context().progress


def shown(capsys, fractions):
    with ProgressBar("working", shown=True) as bar:
        bar._bar.mininterval = 0
        for fraction in fractions:
            bar(fraction, "deblurring")
    err = capsys.readouterr().err
    return err, [int(share) for share in re.findall(r"(\d+)%", err)]


def test_the_bar_shows_the_step_and_the_share(capsys):
    err, percent = shown(capsys, [0.1, 0.5, 1.0])
    assert {10, 50, 100} <= set(percent)
    assert "deblurring" in err
    assert "left" in err


def test_the_bar_never_runs_backwards_nor_past_the_end(capsys):
    _, percent = shown(capsys, [0.5, 0.2, 0.6, 7.0, float("nan")])
    assert percent == sorted(percent)
    assert percent[-1] == 100


def test_the_bar_vanishes(capsys):
    err, _ = shown(capsys, [0.5])
    assert err.split("\r")[-1].strip() == ""


def test_the_bar_is_closed_by_an_exception(capsys):
    with pytest.raises(KeyboardInterrupt), ProgressBar("working", shown=True) as bar:
        raise KeyboardInterrupt
    assert bar._bar is None
    assert capsys.readouterr().err.split("\r")[-1].strip() == ""


@pytest.mark.skipif(sys.platform == "win32", reason="has no such terminals")
@pytest.mark.parametrize("size", [(0, 0), (0, 80), (24, 0), (24, 80)])
def test_a_terminal_of_no_size_gets_a_line(size):
    import fcntl  # noqa: PLC0415 - not on Windows
    import pty  # noqa: PLC0415
    import termios  # noqa: PLC0415

    code = (
        "from deshake.cli.context import ProgressBar\n"
        "with ProgressBar('a.jpg', shown=True) as bar: bar(0.5, 'deblurring')"
    )
    ours, theirs = pty.openpty()
    try:
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", *size, 0, 0))
        subprocess.run([sys.executable, "-c", code], stderr=theirs, check=True)
        shown = os.read(ours, 10_000).decode()
    finally:
        os.close(ours)
        os.close(theirs)
    assert "a.jpg   0%|" in shown
    assert " left\r" in shown
