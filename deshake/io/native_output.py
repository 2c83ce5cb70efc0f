"""What libraries in C print on stderr: kept from the user, who is told of damage in one line."""

from __future__ import annotations

import contextlib
import os
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["silenced"]

_STDERR = 2
_lock = threading.Lock()
_depth = 0
_saved = -1


@contextlib.contextmanager
def silenced() -> Iterator[None]:
    """Keep all that is printed on file descriptor 2 from being seen, in every thread.

    For short calls of libraries that print what they find wrong in a file. May be nested, and used
    by several threads at once. Without a stderr nothing is done.
    """
    _enter()
    try:
        yield
    finally:
        _leave()


def _enter() -> None:
    global _depth, _saved  # noqa: PLW0603 - a file descriptor is the process's own
    with _lock:
        if _depth == 0:
            try:
                _saved = os.dup(_STDERR)
            except OSError:  # there is none
                _saved = -1
            else:
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, _STDERR)
                os.close(nowhere)
        _depth += 1


def _leave() -> None:
    global _depth  # noqa: PLW0603 - as above
    with _lock:
        _depth -= 1
        if _depth == 0 and _saved >= 0:
            os.dup2(_saved, _STDERR)
            os.close(_saved)
