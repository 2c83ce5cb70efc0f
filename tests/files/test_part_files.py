from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from deshake.files.disk import atomic_write
from deshake.files.part_files import create_part, remove_stale_parts

HOLD = """
import sys
from deshake.files.disk import atomic_write
with atomic_write(sys.argv[1]) as stream:
    stream.write(b"half")
    stream.flush()
    print("writing", flush=True)
    sys.stdin.read()
"""


def test_parts_are_hidden_and_of_ones_own(tmp_path):
    made = [create_part(str(tmp_path)) for _ in range(2)]
    for handle, path in made:
        assert Path(path).name.startswith(".deshake-")
        os.close(handle)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_part_file_is_stale_only_after_its_process_ends(tmp_path):
    words = [sys.executable, "-c", HOLD, str(tmp_path / "out")]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"writing\n"
        assert remove_stale_parts(tmp_path) == 0
        [part] = tmp_path.iterdir()
        assert part.read_bytes() == b"half"
        process.kill()
        process.wait(60)
    assert part.exists()
    assert remove_stale_parts(tmp_path) == 1
    assert list(tmp_path.iterdir()) == []


def test_only_part_files_are_removed(tmp_path):
    names = (".deshake-x.part", ".deshake-0123456789abcdef.part.jpg", "deshake.part", "a.jpg")
    for name in names:
        (tmp_path / name).touch()
    (tmp_path / "to").touch()
    link = tmp_path / ".deshake-0123456789abcdef.part"
    link.symlink_to("to")
    assert remove_stale_parts(tmp_path) == 0
    assert link.is_symlink()
    assert {path.name for path in tmp_path.iterdir()} == {*names, "to", link.name}
    assert remove_stale_parts(tmp_path / "missing") == 0


@pytest.mark.skipif(sys.platform == "win32", reason="open files stay there")
def test_a_part_file_of_this_process_stays(tmp_path):
    with atomic_write(tmp_path / "out") as stream:
        stream.write(b"all")
        assert remove_stale_parts(tmp_path) == 0
    assert (tmp_path / "out").read_bytes() == b"all"
