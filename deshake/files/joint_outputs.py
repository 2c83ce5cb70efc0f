"""Outputs that belong together: they appear together, or not at all."""

from __future__ import annotations

import contextlib
import os
from typing import TYPE_CHECKING, BinaryIO, Protocol

from deshake.errors import OutputError
from deshake.files.disk import STREAM, atomic_write, write_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

__all__ = ["AddOutput", "joint_outputs"]

_Identity = tuple[int, ...]


class AddOutput(Protocol):
    """Adds a file to the outputs; ``-`` is standard output."""

    def __call__(
        self,
        path: str | os.PathLike[str],
        data: bytes,
        *,
        overwrite: bool = False,
        modified: int | None = None,
    ) -> None:
        """Add an output; `overwrite` decides whether an existing file may be replaced.

        `modified` is its modification time in nanoseconds, by default the present. The file gets
        this time before its name.

        Raises
        ------
        OutputError
            If the file may not or cannot be written.

        """
        ...


@contextlib.contextmanager
def joint_outputs(*made_from: str | os.PathLike[str]) -> Iterator[AddOutput]:
    """Write files that appear together or not at all.

    All of them are on the disk before the first takes its name. The file that is added last takes
    its name first: if another process has taken that name meanwhile, none of these files appears,
    and the files of the other process remain. Standard output is written after the files. On any
    exception, files that already have their names are removed, but only those that this call
    created.

    Parameters
    ----------
    *made_from : path
        The inputs, whose permissions the files take.

    Yields
    ------
    AddOutput
        Adds an output.

    Raises
    ------
    OutputError
        If a file may not or cannot be written.

    """
    created: list[tuple[str, _Identity]] = []
    streamed: list[bytes] = []
    try:
        with contextlib.ExitStack() as files:

            def add(
                path: str | os.PathLike[str],
                data: bytes,
                *,
                overwrite: bool = False,
                modified: int | None = None,
            ) -> None:
                if os.fspath(path) == STREAM:
                    streamed.append(data)
                else:
                    target = os.fspath(path)
                    stream = files.enter_context(
                        _named_at_the_end(target, created, made_from, overwrite=overwrite)
                    )
                    stream.write(data)
                    stream.flush()
                    if modified is not None:
                        _set_time(stream.fileno(), modified)
                    os.fsync(stream.fileno())

            yield add
        for data in streamed:
            write_bytes(STREAM, data)
    except BaseException:
        for path, identity in created:
            _remove(path, identity)
        raise


@contextlib.contextmanager
def _named_at_the_end(
    path: str,
    created: list[tuple[str, _Identity]],
    made_from: Sequence[str | os.PathLike[str]],
    *,
    overwrite: bool,
) -> Iterator[BinaryIO]:
    """Open a temporary file; give it its name at the end, and record it if the name is new."""
    with atomic_write(path, overwrite=overwrite, made_from=made_from) as stream:
        yield stream
        status = os.fstat(stream.fileno())
        if not os.path.lexists(path):
            created.append((path, _identity(status)))


def _set_time(handle: int, modified: int) -> None:
    """Set the modification time of an open file."""
    if os.utime not in os.supports_fd:
        raise OutputError(
            "this system cannot keep the time of a photo", hint="leave out --preserve"
        )
    with contextlib.suppress(OSError):  # a file system without such times
        os.utime(handle, ns=(os.fstat(handle).st_atime_ns, modified))


def _remove(path: str, identity: _Identity) -> None:
    """Remove a file if it is still the file that was created."""
    with contextlib.suppress(OSError):
        if _identity(os.lstat(path)) == identity:
            os.unlink(path)  # noqa: PTH108


def _identity(status: os.stat_result) -> _Identity:
    """Return values that distinguish a file from its replacement, which may have its inode."""
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
