from __future__ import annotations

import os
from pathlib import Path

import pytest

from deshake.errors import OutputError
from deshake.files.joint_outputs import joint_outputs


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_all_appear_at_the_end(tmp_path):
    with joint_outputs() as add:
        add(tmp_path / "a", b"1")
        add(tmp_path / "b", b"2")
        assert not {"a", "b"} & set(files(tmp_path))
    assert files(tmp_path) == {"a": b"1", "b": b"2"}


def test_none_appear_after_a_failure(tmp_path):
    (tmp_path / "a").write_bytes(b"older")
    with pytest.raises(ValueError, match="no"), joint_outputs() as add:  # noqa: PT012
        add(tmp_path / "a", b"1", overwrite=True)
        add(tmp_path / "b", b"2")
        raise ValueError("no")
    assert files(tmp_path) == {"a": b"older"}


@pytest.mark.parametrize("overwrite", [False, True])
def test_the_files_of_another_process_stay(tmp_path, overwrite):
    with pytest.raises(OutputError, match="exists already"), joint_outputs() as add:  # noqa: PT012
        add(tmp_path / "sheet", b"mine", overwrite=overwrite)
        add(tmp_path / "result", b"mine")
        for name in ("sheet", "result"):
            (tmp_path / name).write_bytes(b"the other's")
    assert files(tmp_path) == {"sheet": b"the other's", "result": b"the other's"}


def test_a_named_file_is_removed_if_another_file_cannot_have_its_name(tmp_path):
    with pytest.raises(OutputError, match="exists already"), joint_outputs() as add:  # noqa: PT012
        add(tmp_path / "sheet", b"mine")
        add(tmp_path / "result", b"mine")
        (tmp_path / "sheet").write_bytes(b"the other's")
    assert files(tmp_path) == {"sheet": b"the other's"}


def test_a_file_that_took_the_place_of_a_new_one_stays(tmp_path, monkeypatch):
    link = os.link

    def replaced_meanwhile(source, target):
        if os.fspath(target).endswith("sheet"):
            (tmp_path / "result").unlink()
            (tmp_path / "result").write_bytes(b"the other's")
            raise FileExistsError
        link(source, target)

    monkeypatch.setattr(os, "link", replaced_meanwhile)
    with pytest.raises(OutputError), joint_outputs() as add:  # noqa: PT012
        add(tmp_path / "sheet", b"mine")
        add(tmp_path / "result", b"mine")
    assert files(tmp_path) == {"result": b"the other's"}


def test_standard_output_comes_last(tmp_path, capfdbinary):
    with joint_outputs() as add:
        add("-", b"shown")
        add(tmp_path / "a", b"1")
        assert capfdbinary.readouterr().out == b""
    assert capfdbinary.readouterr().out == b"shown"
    assert files(tmp_path) == {"a": b"1"}


def test_a_file_has_its_time_before_it_has_its_name(tmp_path, monkeypatch):
    link, seen = os.link, []

    def observed(source, target):
        seen.append(Path(source).stat().st_mtime_ns)
        link(source, target)

    monkeypatch.setattr(os, "link", observed)
    with joint_outputs() as add:
        add(tmp_path / "a", b"1", modified=1_234_567_890_123_456_789)
    assert seen == [1_234_567_890_123_456_789]
    assert (tmp_path / "a").stat().st_mtime_ns == seen[0]


def test_a_named_file_of_another_time_is_removed_after_a_failure(tmp_path):
    with pytest.raises(OutputError, match="exists already"), joint_outputs() as add:  # noqa: PT012
        add(tmp_path / "sheet", b"mine")
        add(tmp_path / "result", b"mine", modified=10**18)
        (tmp_path / "sheet").write_bytes(b"the other's")
    assert files(tmp_path) == {"sheet": b"the other's"}
