from __future__ import annotations

import os
import sys

import pytest

from deshake.files.disk import atomic_write, write_bytes
from deshake.files.joint_outputs import joint_outputs
from deshake.files.permissions import output_mode

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="has no such permissions")


def mode(path):
    return path.stat().st_mode & 0o777


def made(path, permissions):
    path.touch()
    path.chmod(permissions)
    return path


@pytest.fixture
def mask():
    before = os.umask(0o027)
    yield 0o027
    os.umask(before)


def test_an_output_takes_the_permissions_that_all_of_its_inputs_have(tmp_path, mask):
    one, two = made(tmp_path / "one", 0o664), made(tmp_path / "two", 0o640)
    assert output_mode([one]) == 0o664
    assert output_mode([one, two]) == 0o640
    assert output_mode([one, "-"]) == 0o664
    assert output_mode([one, tmp_path / "gone"]) == 0o600
    assert output_mode([]) == output_mode(["-"]) == 0o666 & ~mask
    assert os.umask(mask) == mask


@pytest.mark.parametrize("overwrite", [False, True])
def test_files_are_private_until_they_have_their_names(tmp_path, mask, overwrite):
    one, out = made(tmp_path / "one", 0o664), tmp_path / "out"
    if overwrite:
        made(out, 0o600)
    with atomic_write(out, overwrite=overwrite, made_from=[one]):
        [part] = [path for path in tmp_path.iterdir() if path not in {one, out}]
        assert mode(part) == 0o600
    assert mode(out) == 0o664
    write_bytes(tmp_path / "new", b"")
    assert mode(tmp_path / "new") == 0o666 & ~mask


def test_outputs_that_belong_together_take_the_same_permissions(tmp_path):
    one = made(tmp_path / "one", 0o600)
    with joint_outputs(one) as add:
        add(tmp_path / "a", b"")
        add(tmp_path / "b", b"")
    assert [mode(tmp_path / name) for name in "ab"] == [0o600, 0o600]
