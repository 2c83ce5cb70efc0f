from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from deshake.errors import KernelFileError, OutputError, PhotoError
from deshake.files.disk import atomic_write, check_output, read_bytes, sha256, write_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator

NOBODY = 65534


@contextmanager
def unprivileged() -> Iterator[None]:
    """Act as a user without root's rights, if root runs the tests."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@pytest.fixture
def closed_folder() -> Iterator[Path]:
    """Make a folder that everybody may read and nobody may write to."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o555)
    yield folder
    folder.chmod(0o755)
    shutil.rmtree(folder)


@pytest.mark.parametrize("link", ["same", "symbolic", "hard", "folder"])
@pytest.mark.parametrize("overwrite", [False, True])
def test_output_is_never_the_input(tmp_path: Path, link: str, *, overwrite: bool) -> None:
    source = tmp_path / "a.jpg"
    source.write_bytes(b"x")
    out = tmp_path / "b.jpg"
    if link == "same":
        out = source
    elif link == "symbolic":
        out.symlink_to(source)
    elif link == "hard":
        out.hardlink_to(source)
    else:
        (tmp_path / "again").symlink_to(tmp_path)
        out = tmp_path / "again" / "a.jpg"
    with pytest.raises(OutputError, match="the output is the input itself"):
        check_output(out, source, overwrite=overwrite)


def test_existing_output_needs_overwrite(tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    out.write_bytes(b"old")
    with pytest.raises(OutputError, match="exists already") as caught:
        check_output(out)
    assert "--overwrite" in str(caught.value.hint)
    check_output(out, overwrite=True)


def test_dangling_link_counts_as_existing(tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    out.symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="exists already"):
        check_output(out)


def test_missing_folder_and_folder_as_output(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="no such folder"):
        check_output(tmp_path / "no" / "out.png")
    with pytest.raises(OutputError, match="is a folder"):
        check_output(tmp_path, overwrite=True)
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OutputError, match="is not a folder"):
        check_output(tmp_path / "file" / "out.png")


def test_unwritable_folder_is_refused_before_and_while_writing(closed_folder: Path) -> None:
    with unprivileged():
        with pytest.raises(OutputError, match="not writable"):
            check_output(closed_folder / "out.png")
        with pytest.raises(OutputError, match="not writable"):
            write_bytes(closed_folder / "out.png", b"data")
    assert not list(closed_folder.iterdir())


def test_a_written_file_is_whole_and_alone_in_its_folder(tmp_path: Path) -> None:
    out = tmp_path / ("n" * 240 + ".png")  # so long that no suffix would fit
    with atomic_write(out) as stream:
        stream.write(b"da")
        assert not out.exists()
        stream.write(b"ta")
    assert out.read_bytes() == b"data"
    assert list(tmp_path.iterdir()) == [out]
    mask = os.umask(0)
    os.umask(mask)
    assert out.stat().st_mode & 0o777 == 0o666 & ~mask


def test_overwrite_replaces_and_its_absence_never_does(tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    out.write_bytes(b"old")
    with pytest.raises(OutputError, match="exists already"):
        write_bytes(out, b"new")
    assert out.read_bytes() == b"old"
    write_bytes(out, b"new", overwrite=True)
    assert out.read_bytes() == b"new"


def test_a_file_that_appears_meanwhile_is_kept(tmp_path: Path) -> None:
    out = tmp_path / "out.png"

    def race() -> None:
        with atomic_write(out) as stream:
            stream.write(b"mine")
            out.write_bytes(b"theirs")

    with pytest.raises(OutputError, match="exists already"):
        race()
    assert out.read_bytes() == b"theirs"
    assert list(tmp_path.iterdir()) == [out]


def test_overwriting_a_link_keeps_its_target(tmp_path: Path) -> None:
    target, out = tmp_path / "target", tmp_path / "out.png"
    target.write_bytes(b"old")
    out.symlink_to(target)
    write_bytes(out, b"new", overwrite=True)
    assert (target.read_bytes(), out.read_bytes()) == (b"old", b"new")


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, SystemExit])
def test_nothing_is_left_after_an_exception(tmp_path: Path, error: type[BaseException]) -> None:
    out = tmp_path / "out.png"
    out.write_bytes(b"old")

    def stop() -> None:
        with atomic_write(out, overwrite=True) as stream:
            stream.write(b"half")
            raise error

    with pytest.raises(error):
        stop()
    assert list(tmp_path.iterdir()) == [out]
    assert out.read_bytes() == b"old"


@pytest.mark.parametrize("existing", [False, True])
def test_a_full_disk_leaves_nothing_half_written(tmp_path: Path, *, existing: bool) -> None:
    out = tmp_path / "out.png"
    if existing:
        out.write_bytes(b"old")
    code = (
        "import resource, sys\n"
        "from deshake.errors import OutputError\n"
        "from deshake.files.disk import write_bytes\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        "try:\n"
        "    write_bytes(sys.argv[1], bytes(1_000_000), overwrite=True)\n"
        "except OutputError as error:\n"
        "    print(error, error.hint, sep='|')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(out)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    message, hint = done.stdout.strip().split("|")
    assert "larger than the allowed file size" in message
    assert "ulimit" in hint
    assert list(tmp_path.iterdir()) == ([out] if existing else [])
    assert not existing or out.read_bytes() == b"old"


def test_a_full_device_is_named(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    code = "from deshake.files.disk import write_bytes\nwrite_bytes('-', b'data')"
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-c", code],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            cwd=Path(__file__).parents[2],
        )
    assert "no space left on the device" in done.stderr.replace("Exception ignored", "")
    assert not list(tmp_path.iterdir())


def test_standard_streams(tmp_path: Path) -> None:
    code = (
        "from deshake.errors import KernelFileError\n"
        "from deshake.files.disk import read_bytes, write_bytes\n"
        "write_bytes('-', read_bytes('-', 100, KernelFileError)[::-1])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=b"\0\xff\n1",
        capture_output=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    assert done.stdout == b"1\n\xff\0"
    assert not list(tmp_path.iterdir())


def test_no_binary_data_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    main, terminal = os.openpty()
    try:
        with open(terminal, "w", closefd=False) as out, open(terminal, closefd=False) as into:
            monkeypatch.setattr(sys, "stdout", out)
            monkeypatch.setattr(sys, "stdin", into)
            with pytest.raises(OutputError, match="terminal"):
                write_bytes("-", b"data")
            with pytest.raises(KernelFileError, match="terminal"):
                read_bytes("-", 10, KernelFileError)
            monkeypatch.undo()
    finally:
        os.close(main)
        os.close(terminal)


def test_reading_reports_errors_of_the_callers_class(tmp_path: Path) -> None:
    with pytest.raises(PhotoError, match="no such file"):
        read_bytes(tmp_path / "no", 10, PhotoError)
    with pytest.raises(KernelFileError, match="is a folder"):
        read_bytes(tmp_path, 10, KernelFileError)
    path = tmp_path / "file"
    path.write_bytes(bytes(11))
    with pytest.raises(PhotoError, match="larger than"):
        read_bytes(path, 10, PhotoError)
    assert read_bytes(path, 11, PhotoError) == bytes(11)
    tmp_path.chmod(0o755)
    path.chmod(0)
    with unprivileged(), pytest.raises(PhotoError):
        read_bytes(path, 11, PhotoError)


def test_sha256_is_that_of_the_bytes(tmp_path):
    file = tmp_path / "a"
    file.write_bytes(b"abc")
    assert sha256(file).startswith("ba7816bf8f01cfea414140de5dae2223")
