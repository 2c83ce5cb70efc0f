"""Who may read an output: those who may read all its inputs."""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["PRIVATE", "output_mode"]

PRIVATE: Final = 0o600
"""Permissions of a file that only its owner may read."""

_STREAM: Final = "-"
_lock = threading.Lock()


def output_mode(inputs: Iterable[str | os.PathLike[str]]) -> int:
    """Return the permissions of an output: those that all of its inputs have.

    Without inputs, or if all are standard input, they are the system's default for a new file. If
    an input no longer exists, only the owner may read the output.

    Parameters
    ----------
    inputs : iterable of path
        The inputs of the output.

    Returns
    -------
    int
        Permission bits, at most 0o777.

    """
    files = [path for path in inputs if os.fspath(path) != _STREAM]
    if not files:
        return 0o666 & ~_umask()
    mode = 0o777
    for path in files:
        try:
            mode &= os.stat(path).st_mode  # noqa: PTH116
        except OSError:
            mode &= PRIVATE
    return mode


def _umask() -> int:
    """Return the process's mask; reading it requires setting it."""
    with _lock:
        mask = os.umask(0o077)
        os.umask(mask)
    return mask
