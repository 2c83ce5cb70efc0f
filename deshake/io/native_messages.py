"""What a library in C prints on standard error, caught: deshake says itself what is wrong."""

from __future__ import annotations

import contextlib
import os
import tempfile
import threading
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["native_messages"]

_STDERR: Final = 2
_LOCK = threading.Lock()


@contextlib.contextmanager
def native_messages(*known: bytes) -> Iterator[list[str]]:
    """Catch the lines that are printed on standard error meanwhile and hold a known text.

    All other lines go there afterwards.

    Parameters
    ----------
    known : bytes
        Texts by which the library's lines are known.

    Yields
    ------
    list of str
        The lines; it is filled at the end.

    """
    found: list[str] = []
    with _LOCK, tempfile.TemporaryFile() as caught:
        try:
            kept = os.dup(_STDERR)
        except OSError:  # there is no standard error
            yield found
            return
        os.dup2(caught.fileno(), _STDERR)
        try:
            yield found
        finally:
            os.dup2(kept, _STDERR)
            caught.seek(0)
            for line in caught:
                if any(text in line for text in known):
                    found.append(line.decode("utf-8", "replace").strip())
                else:
                    os.write(kept, line)
            os.close(kept)
