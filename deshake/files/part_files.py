"""Part files: temporary files that hold an output until it is whole.

A part file is locked while its process runs. When the process ends, the system releases the lock.
A part file without a lock is stale.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
from importlib import import_module
from typing import TYPE_CHECKING

from deshake.files.permissions import PRIVATE

if TYPE_CHECKING:
    from types import ModuleType

fcntl: ModuleType | None
try:
    fcntl = import_module("fcntl")
except ImportError:  # Windows, which never removes an open file
    fcntl = None

__all__ = ["create_part", "remove_stale_parts"]

_NAME = re.compile(r"\.deshake-[0-9a-f]{16}\.part")
_BINARY: int = getattr(os, "O_BINARY", 0)  # only Windows distinguishes text from binary
_FOLLOW: int = getattr(os, "O_NOFOLLOW", 0)


def create_part(folder: str) -> tuple[int, str]:
    """Create and lock a hidden, empty part file in a folder; only its owner may read it.

    Returns
    -------
    handle : int
        Its descriptor, for writing.
    path : str
        Its name.

    Raises
    ------
    OSError
        If the system refuses.

    """
    while True:
        path = os.path.join(folder, f".deshake-{secrets.token_hex(8)}.part")  # noqa: PTH118
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, PRIVATE)
        if fcntl is None:
            return handle, path
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        if os.fstat(handle).st_nlink:
            return handle, path
        os.close(handle)  # another process removed it as stale before the lock


def remove_stale_parts(folder: str | os.PathLike[str]) -> int:
    """Remove the part files in a folder whose processes have ended; return their number."""
    try:
        with os.scandir(folder or ".") as entries:
            parts = [entry.path for entry in entries if _NAME.fullmatch(entry.name)]
    except OSError:
        return 0
    return sum(map(_removed, parts))


def _removed(path: str) -> bool:
    """Remove a part file unless a process holds its lock; return whether it was removed."""
    try:
        if fcntl is None:
            os.unlink(path)  # noqa: PTH108
            return True
        handle = os.open(path, os.O_WRONLY | _FOLLOW)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.unlink(path)  # noqa: PTH108
    except OSError:
        return False
    finally:
        os.close(handle)
    return True
