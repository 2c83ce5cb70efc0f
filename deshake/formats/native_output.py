"""Captures the output of C libraries on stderr: deshake itself reports damage in one line."""

from __future__ import annotations

import contextlib
import os
import tempfile
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import BinaryIO

__all__ = ["silenced"]

_STDERR = 2
_lock = threading.Lock()
_depth = 0
_saved = -1
_caught: BinaryIO | None = None


@contextlib.contextmanager
def silenced() -> Iterator[list[str]]:
    """Capture all output to file descriptor 2, of every thread.

    It serves short calls of libraries that print errors of a file. Calls may be nested, and several
    threads may use it at once. Without a stderr it does nothing.

    Yields
    ------
    list of str
        The lines that were printed meanwhile; the list is filled at the end.

    """
    lines: list[str] = []
    start = _enter()
    try:
        yield lines
    finally:
        lines += _leave(start)


def _enter() -> int:
    """Redirect stderr to a file, if it is not redirected yet; return the length of the file."""
    global _caught, _depth, _saved  # noqa: PLW0603 - a file descriptor is the process's own
    with _lock:
        if _depth == 0:
            try:
                _saved = os.dup(_STDERR)
            except OSError:  # there is none
                _saved = -1
            else:
                _caught = tempfile.TemporaryFile()  # noqa: SIM115 - closed by the last to leave
                os.dup2(_caught.fileno(), _STDERR)
        _depth += 1
        return 0 if _caught is None else os.fstat(_caught.fileno()).st_size


def _leave(start: int) -> list[str]:
    """Return the lines that were printed since `start`; the last call restores stderr."""
    global _caught, _depth  # noqa: PLW0603 - as above
    with _lock:
        printed = b""
        if _caught is not None:
            _caught.seek(start)
            printed = _caught.read()  # to the end, where the next output goes
        _depth -= 1
        if _depth == 0 and _caught is not None:
            os.dup2(_saved, _STDERR)
            os.close(_saved)
            _caught.close()
            _caught = None
        return printed.decode("utf-8", "replace").splitlines()
