"""Distinguish deshake's own files by their arrays: kernel, camera and registration files."""

from __future__ import annotations

import zipfile
from typing import TYPE_CHECKING, Final

from deshake.errors import KernelFileError
from deshake.files.kernel_file import CameraFile, KernelFile, read_camera, read_kernel
from deshake.files.registration_file import RegistrationFile, read_registration

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

__all__ = ["Artifact", "is_artifact", "read_artifact"]

Artifact = KernelFile | CameraFile | RegistrationFile

_ZIP: Final = b"PK"
_MARKS: Final[dict[str, Callable[[Path], Artifact]]] = {
    "weights": read_kernel,
    "scale": read_registration,
    "source": read_camera,
}
"""An array that only one kind of file has, and the function that reads that kind."""


def is_artifact(path: Path) -> bool:
    """Return whether a file is one of deshake's, by its name or its first bytes."""
    if path.suffix.lower() == ".npz":
        return True
    try:
        if not path.is_file():
            return False
        with path.open("rb") as stream:
            return stream.read(len(_ZIP)) == _ZIP
    except OSError:
        return False


def read_artifact(path: Path) -> Artifact:
    """Read a kernel, camera or registration file.

    Raises
    ------
    KernelFileError
        If it cannot be read, or is none of them.

    """
    names = _arrays(path)
    read = next((read for mark, read in _MARKS.items() if f"{mark}.npy" in names), None)
    if read is not None:
        return read(path)
    if names:
        raise KernelFileError(
            "no kernel, camera or registration file",
            hint="docs/kernel-files.md describes what these files hold",
            file=path,
        )
    return read_kernel(path)  # its error says what is wrong


def _arrays(path: Path) -> set[str]:
    """Return the names of the arrays of a file; none, if it cannot be read."""
    try:
        with zipfile.ZipFile(path) as archive:
            return set(archive.namelist())
    except (OSError, ValueError, LookupError, zipfile.BadZipFile, NotImplementedError):
        return set()
