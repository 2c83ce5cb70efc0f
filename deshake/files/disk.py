"""Reads inputs; checks outputs, and writes them whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import stat
import sys
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from deshake.errors import OutputError
from deshake.files.part_files import create_part
from deshake.files.permissions import output_mode

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from deshake.errors import DeshakeError

__all__ = [
    "STREAM",
    "atomic_write",
    "check_input",
    "check_output",
    "read_bytes",
    "sha256",
    "write_bytes",
]

STREAM = "-"
"""The name that stands for standard input or standard output."""

_OVERWRITE_HINT = "choose another name with -o, or allow replacing it with --overwrite"
_FOLDER_HINT = "choose another place with -o"
_NO_HARD_LINKS = {errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK}
_REASONS = {
    errno.ENOSPC: ("no space left on the device", "free some space, or write elsewhere with -o"),
    errno.EDQUOT: ("the disk quota is used up", "free some space, or write elsewhere with -o"),
    errno.EFBIG: ("larger than the allowed file size", "raise the limit (ulimit -f)"),
    errno.EACCES: ("the folder is not writable", _FOLDER_HINT),
    errno.EPERM: ("writing is not permitted", _FOLDER_HINT),
    errno.EROFS: ("the file system is read-only", _FOLDER_HINT),
    errno.ENAMETOOLONG: ("the name is too long", "choose a shorter one with -o"),
}


def check_output(
    out: str | os.PathLike[str], *inputs: str | os.PathLike[str], overwrite: bool = False
) -> None:
    """Check that a file may be written, before any work begins.

    Raises
    ------
    OutputError
        If the output is one of the inputs (also through symbolic or hard links), exists and may
        not be replaced, is a folder, or lies in a folder that is missing or not writable.

    """
    path = os.fspath(out)
    if path == STREAM:
        return
    if any(_same_file(path, os.fspath(item)) for item in inputs):
        raise OutputError(
            "the output is the input itself, which deshake never touches",
            hint="choose another name with -o",
            file=path,
        )
    if os.path.isdir(path):  # noqa: PTH112 - no error for a parent that may not be entered
        raise OutputError("is a folder", hint="name a file with -o", file=path)
    if os.path.lexists(path) and not overwrite:
        raise OutputError("exists already", hint=_OVERWRITE_HINT, file=path)
    folder = os.path.dirname(path) or "."  # noqa: PTH120
    if not os.path.isdir(folder):  # noqa: PTH112
        missing = "is not a folder" if os.path.exists(folder) else "no such folder"  # noqa: PTH110
        raise OutputError(missing, hint="make it first, or choose another with -o", file=folder)
    effective = os.access in os.supports_effective_ids
    if not os.access(folder, os.W_OK | os.X_OK, effective_ids=effective):
        raise OutputError("the folder is not writable", hint=_FOLDER_HINT, file=folder)


@contextlib.contextmanager
def atomic_write(
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    made_from: Sequence[str | os.PathLike[str]] = (),
) -> Iterator[BinaryIO]:
    """Open a binary file that appears under its name whole, or not at all.

    The bytes go to a hidden temporary file in the same folder, and are flushed to the disk. Then
    the file takes its name in one step. On any exception, an interrupt included, the temporary file
    is removed and an existing `path` is unchanged. `part_files.remove_stale_parts` removes the
    temporary files of killed processes.

    Parameters
    ----------
    path : path
        The file to write. A symbolic link is replaced, not followed.
    overwrite : bool, keyword-only
        Whether an existing file may be replaced; checked again at the last moment.
    made_from : sequence of path, keyword-only
        The inputs, whose permissions the file takes; only its owner can read the temporary file.

    Raises
    ------
    OutputError
        If `path` exists and may not be replaced, or the system refuses to write.

    """
    target = os.fspath(path)
    if not overwrite and os.path.lexists(target):
        raise OutputError("exists already", hint=_OVERWRITE_HINT, file=target)
    folder = os.path.dirname(target)  # noqa: PTH120
    try:
        handle, part = create_part(folder)
    except OSError as error:
        raise _output_error(error, target) from error
    stream = os.fdopen(handle, "wb")
    try:
        yield stream
        stream.flush()
        os.fsync(handle)
        stream.close()
        with contextlib.suppress(OSError):  # a file system without permissions
            os.chmod(part, output_mode(made_from))  # noqa: PTH101
        _take_name(part, target, overwrite=overwrite)
    except BaseException as error:
        with contextlib.suppress(OSError):
            stream.close()  # it tries again to flush the rest
        with contextlib.suppress(OSError):
            os.unlink(part)  # noqa: PTH108
        if isinstance(error, OSError):
            raise _output_error(error, target) from error
        raise


def write_bytes(
    path: str | os.PathLike[str],
    data: bytes,
    *,
    overwrite: bool = False,
    made_from: Sequence[str | os.PathLike[str]] = (),
) -> None:
    """Write a whole file; ``-`` is standard output.

    The parameters are those of `atomic_write`.

    Raises
    ------
    OutputError
        For the reasons of `atomic_write`, or if standard output is a terminal.

    """
    if os.fspath(path) != STREAM:
        with atomic_write(path, overwrite=overwrite, made_from=made_from) as stream:
            stream.write(data)
        return
    if sys.stdout.isatty():
        raise OutputError(
            "binary data does not go to a terminal",
            hint="redirect standard output, or name a file with -o",
        )
    try:
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    except OSError as error:
        raise _output_error(error, "standard output") from error


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal: provenance identifies a photo by it."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def read_bytes(path: str | os.PathLike[str], limit: int, error: type[DeshakeError]) -> bytes:
    """Read a whole file of at most `limit` bytes; ``-`` is standard input.

    Raises
    ------
    DeshakeError
        Of the class `error`: if the file does not exist, is a folder, is not readable or is larger
        than `limit`, or if standard input is a terminal.

    """
    name = os.fspath(path)
    if name == STREAM:
        name = "standard input"
    with _reading(name, error):
        if name != os.fspath(path):
            if sys.stdin.isatty():
                raise error("nothing to read: it is a terminal", hint="name a file", file=name)
            data = _read_at_most(sys.stdin.buffer, limit)
        else:
            with Path(name).open("rb") as stream:
                data = _read_at_most(stream, limit)
    if data is None:
        raise error(f"larger than {limit / 1e6:.0f} MB", file=name)
    return data


def check_input(path: str | os.PathLike[str], error: type[DeshakeError]) -> None:
    """Check that a file exists and may be read; ``-``, standard input, always passes.

    Raises
    ------
    DeshakeError
        Of the class `error`, as `read_bytes` does.

    """
    name = os.fspath(path)
    if name == STREAM:
        return
    with _reading(name, error):
        if stat.S_ISFIFO(os.stat(name).st_mode):  # noqa: PTH116 - opening it would wait
            return
        with Path(name).open("rb"):
            pass


@contextlib.contextmanager
def _reading(name: str, error: type[DeshakeError]) -> Iterator[None]:
    """Turn a system error while reading into one line."""
    try:
        yield
    except FileNotFoundError as cause:
        raise error("no such file", hint="check the name", file=name) from cause
    except IsADirectoryError as cause:
        raise error("is a folder, not a file", hint="name a file in it", file=name) from cause
    except OSError as cause:
        raise error(_reason(cause), file=name) from cause


_PIECE = 1 << 20  # bytes that are read at once


def _read_at_most(stream: BinaryIO, limit: int) -> bytes | None:
    """Read a stream, in pieces if its size is unknown; None if it is larger than the limit."""
    size = os.fstat(stream.fileno()).st_size
    if size > limit:
        return None
    data = stream.read(size + 1)  # one byte more, to detect the end
    if len(data) <= size:
        return data
    pieces, length = [data], len(data)
    while piece := stream.read(_PIECE):
        pieces.append(piece)
        length += len(piece)
        if length > limit:
            return None
    return b"".join(pieces)


def _same_file(a: str, b: str) -> bool:
    """Return whether two names stand for one file: by the resolved path or the inode."""
    if os.path.realpath(a) == os.path.realpath(b):
        return True
    try:
        return os.path.samefile(a, b)  # noqa: PTH121
    except OSError:
        return False


def _take_name(part: str, target: str, *, overwrite: bool) -> None:
    """Give the finished temporary file its name; replace a file only with `overwrite`."""
    if overwrite:
        os.replace(part, target)  # noqa: PTH105
        return
    try:
        os.link(part, target)  # fails if the name exists by now
    except FileExistsError as error:
        raise OutputError("exists already", hint=_OVERWRITE_HINT, file=target) from error
    except OSError as error:
        if error.errno not in _NO_HARD_LINKS:
            raise
        os.replace(part, target)  # noqa: PTH105 - a file system without hard links
    else:
        os.unlink(part)  # noqa: PTH108


def _output_error(error: OSError, file: str) -> OutputError:
    """Turn a system error while writing into one line."""
    _, hint = _REASONS.get(error.errno or 0, ("", None))
    return OutputError(f"cannot be written: {_reason(error)}", hint=hint, file=file)


def _reason(error: OSError) -> str:
    reason, _ = _REASONS.get(error.errno or 0, (error.strerror or str(error), None))
    return reason[:1].lower() + reason[1:]
