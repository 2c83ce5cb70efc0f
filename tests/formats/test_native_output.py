from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from deshake.formats.native_output import silenced


def test_output_is_hidden_inside_and_visible_outside(capfd: pytest.CaptureFixture[str]) -> None:
    os.write(2, b"before ")
    with silenced(), silenced():
        os.write(2, b"inside ")
    os.write(2, b"after")
    assert capfd.readouterr().err == "before after"


def test_the_printed_lines_are_returned() -> None:
    with silenced() as outer:
        os.write(2, b"one\n")
        with silenced() as inner:
            os.write(2, b"two\nthree")
    assert inner == ["two", "three"]
    assert outer == ["one", "two", "three"]
    with silenced() as again:
        pass
    assert again == []


def test_an_error_ends_the_silence(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(OSError, match="wrong"), silenced():
        raise OSError("wrong")
    os.write(2, b"after")
    assert capfd.readouterr().err == "after"


def test_threads_do_not_leave_each_other_silent(capfd: pytest.CaptureFixture[str]) -> None:
    def often() -> None:
        for _ in range(200):
            with silenced():
                os.write(2, b"inside")

    threads = [threading.Thread(target=often) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    os.write(2, b"after")
    assert capfd.readouterr().err == "after"


def test_a_program_without_stderr_continues() -> None:
    program = (
        "import os; os.close(2)\n"
        "from deshake.formats.native_output import silenced\n"
        "with silenced(): print('done')"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert run.stdout == "done\n"
