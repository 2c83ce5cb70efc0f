from __future__ import annotations

import os

import pytest

from deshake.io.native_messages import native_messages


def test_known_lines_are_caught_and_others_pass(capfd):
    with native_messages(b"corrupted", b"end of file") as lines:
        os.write(2, b"data corrupted at 9\n")
        os.write(2, b"something else\n")
        os.write(2, b"Unexpected end of file")
    assert lines == ["data corrupted at 9", "Unexpected end of file"]
    assert capfd.readouterr().err == "something else\n"
    os.write(2, b"corrupted\n")
    assert capfd.readouterr().err == "corrupted\n"


def test_standard_error_is_back_after_an_error(capfd):
    def fail():
        os.write(2, b"x\n")
        raise ValueError("own")

    with pytest.raises(ValueError, match="own"), native_messages(b"x"):
        fail()
    os.write(2, b"x\n")
    assert capfd.readouterr().err == "x\n"


def test_nothing_is_left_open():
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0  # noqa: PTH112, PTH208
    for _ in range(5):
        with native_messages(b"x"):
            os.write(2, b"x\n")
    after = len(os.listdir("/proc/self/fd")) if before else 0  # noqa: PTH208
    assert after == before
