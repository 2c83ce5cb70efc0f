"""Make the folder that outputs go to."""

from __future__ import annotations

import errno
import os
import stat
from typing import TYPE_CHECKING

from deshake.errors import OutputError

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["check_folder", "make_folder"]


def make_folder(path: Path, *, parents: bool = False) -> None:
    """Make a folder, unless it is there.

    Parameters
    ----------
    path : Path
        The folder.
    parents : bool
        Whether the folders above it may be made, too.

    Raises
    ------
    OutputError
        If it cannot be made.

    """
    if path.is_dir():
        return
    try:
        path.mkdir(parents=parents)
    except OSError as error:
        raise _no_folder(path, error.errno or 0) from error


def check_folder(path: Path) -> None:
    """Check that a folder is there, or can be made.

    Raises
    ------
    OutputError
        If it cannot be made.

    """
    if path.is_dir():
        return
    if os.path.lexists(path):
        raise _no_folder(path, errno.EEXIST)
    try:
        above = path.parent.stat()
    except OSError as error:
        raise _no_folder(path, error.errno or 0) from error
    if not stat.S_ISDIR(above.st_mode):
        raise _no_folder(path, errno.ENOTDIR)
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise _no_folder(path, errno.EACCES)


def _no_folder(path: Path, number: int) -> OutputError:
    """Return why a folder cannot be made, by the number of the system's error."""
    if number == errno.EEXIST:
        return OutputError("is not a folder", hint="name a folder", file=path)
    return OutputError(
        f"the folder cannot be made: {os.strerror(number).lower()}",
        hint="make it first, or choose another",
        file=path,
    )
