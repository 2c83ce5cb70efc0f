"""Find the photos: the files that the user names, and those in folders, in natural order."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from deshake.errors import PhotoError
from deshake.formats.encoding import READ_ONLY, SUFFIXES
from deshake.pictures.comparison import SUFFIX as SHEET
from deshake.stages.blending import MASK

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

__all__ = ["InputPhoto", "find_photos", "identity", "natural_order"]

_RESULTS = (".deshaken", SHEET, MASK)
_SUFFIXES = frozenset([*SUFFIXES, *READ_ONLY])


@dataclass(frozen=True)
class InputPhoto:
    """A photo that the user names, or a photo in a folder.

    Parameters
    ----------
    path : Path
        The photo.
    below : Path
        Its folder, relative to the named folder.

    """

    path: Path
    below: Path = Path()


def find_photos(
    inputs: Sequence[Path], *, recursive: bool = False, without: Sequence[Path] = ()
) -> list[InputPhoto]:
    """List the photos among `inputs` and those in the folders among them.

    In a folder, a photo is a file with the ending of a photo format. Hidden files and results of
    deshake itself (``<stem>.deshaken.<ext>``, ``<stem>.compare.png``, ``<stem>.mask.png``) are left
    out. Photos of a folder come in natural order (``IMG_2`` before ``IMG_10``), and before those of
    the folders in it.

    Parameters
    ----------
    inputs : sequence of Path
        Photos and folders of photos.
    recursive : bool, keyword-only
        Whether folders in folders are searched, too. Each is searched once, even if symbolic links
        form a circle.
    without : sequence of Path, keyword-only
        Folders in these folders that are not searched: those where results go.

    Raises
    ------
    PhotoError
        If a folder has no photos, or cannot be read.

    """
    photos: list[InputPhoto] = []
    left_out = {known for path in without if (known := identity(path))}
    for path in inputs:
        if not path.is_dir():
            photos.append(InputPhoto(path))
            continue
        visited = set(left_out)
        inside = list(_in_folder(path, Path(), visited, recursive=recursive))
        if not inside:
            elsewhere = "" if recursive else "; folders in it are searched with -r only"
            raise PhotoError(
                "there are no photos in this folder",
                hint=f"photos end in .jpg, .tif, .dng and the like{elsewhere}",
                file=path,
            )
        photos += inside
    return photos


def natural_order(name: str) -> tuple[list[tuple[int, int, str]], str]:
    """Return the sort key of a name: numbers by their value, and letters without their case.

    Names that are alike in both are sorted by their characters.
    """
    parts = re.split(r"([0-9]+)", name)
    key = [(0, int(part), "") if part.isdecimal() else (1, 0, part.casefold()) for part in parts]
    return key, name


def identity(path: Path) -> tuple[int, int] | None:
    """Return the identity of a file, whatever its names; None: no such file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _in_folder(
    folder: Path, below: Path, visited: set[tuple[int, int]], *, recursive: bool
) -> Iterator[InputPhoto]:
    """Yield the photos of a folder and, if `recursive`, of its folders not yet visited."""
    visited.add(identity(folder) or (0, 0))
    try:
        with os.scandir(folder) as entries:
            shown = [entry for entry in entries if not entry.name.startswith(".")]
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise PhotoError(f"the folder cannot be read: {reason}", file=folder) from error
    shown.sort(key=lambda entry: natural_order(entry.name))
    yield from (InputPhoto(folder / entry.name, below) for entry in shown if _is_photo(entry))
    if not recursive:
        return
    for entry in shown:
        path = folder / entry.name
        if entry.is_dir() and identity(path) not in visited:
            yield from _in_folder(path, below / entry.name, visited, recursive=True)


def _is_photo(entry: os.DirEntry[str]) -> bool:
    stem, suffix = os.path.splitext(entry.name)  # noqa: PTH122 - 100 000 names
    return suffix.lower() in _SUFFIXES and not stem.endswith(_RESULTS) and entry.is_file()
