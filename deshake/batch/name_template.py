"""Templates for the names of results: ``sharp/{folder}/{stem}_sharp.{ext}``.

A brace that belongs to the name is written twice.
"""

from __future__ import annotations

import os
import string
from pathlib import Path
from typing import TYPE_CHECKING, Final

from deshake.errors import OutputError
from deshake.formats.encoding import SUFFIXES
from deshake.formats.output_names import output_ending

if TYPE_CHECKING:
    from deshake.batch.folders import InputPhoto
    from deshake.formats.encoding import Format

__all__ = ["FIELDS", "NameTemplate"]

FIELDS: Final = ("folder", "parent", "stem", "ext")
"""The fields of a template; a photo gives their values."""

_NAMES: Final = ", ".join(f"{{{field}}}" for field in FIELDS)
_ENDING: Final = ".{ext}"


class NameTemplate:
    """A template for the names of results.

    ``{folder}`` is the folder of the photo below the folder that the user named; it is empty for a
    photo that the user named. ``{parent}`` is the name of the folder in which the photo lies.
    ``{stem}`` and ``{ext}`` are the photo's name and the ending of the result.

    Parameters
    ----------
    text : str
        The template. Without any field it is the name itself, with the doubled braces undone.
    form : Format, optional
        The format of the results; by default that of the ending.

    Raises
    ------
    ValueError
        If a brace is not closed, a field is unknown, or ``..`` follows a field. If the ending
        stands for no format that deshake writes, or for another format than `form`.

    """

    def __init__(self, text: str, form: Format | None = None) -> None:
        parts = [_parsed(part) for part in _checked_parts(text)]
        self._parts = parts
        self._form = form
        self.has_fields = any(field for part in parts for _, field in part)
        if not self.has_fields:
            return
        first = next(at for at, part in enumerate(parts) if any(field for _, field in part))
        if any(part == [("..", None)] for part in parts[first:]):
            raise ValueError("there may be no .. behind a field")
        self.top = Path(*["".join(literal for literal, _ in part) for part in parts[:first]])
        self._check_ending(Path(text).name)

    @property
    def name(self) -> Path:
        """The template's text as a name, if it has no fields."""
        return Path(*["".join(literal for literal, _ in part) for part in self._parts])

    def place(self, photo: InputPhoto) -> Path:
        """Return where the result of a photo goes.

        Raises
        ------
        OutputError
            If the name of the photo leads out of the folder that the template names.

        """
        path = photo.path
        values = {
            "folder": os.fspath(photo.below) if photo.below.parts else "",
            "parent": Path(os.path.abspath(path)).parent.name,  # noqa: PTH100 - links stay
            "stem": path.stem,
            "ext": output_ending(path, self._form).removeprefix("."),
        }
        filled = [
            "".join(literal + (values[field] if field else "") for literal, field in part)
            for part in self._parts
        ]
        result = Path(*filled)
        if ".." in result.parts[len(self.top.parts) :]:
            raise OutputError(
                f"its name leads out of {self.top}", hint="name its result with -o", file=path
            )
        return result

    def _check_ending(self, last: str) -> None:
        """Check the ending of the last part, which is either a field or literal."""
        if last.endswith(_ENDING):
            return
        suffix = "." + last.rpartition(".")[2].lower()
        stated = SUFFIXES.get(suffix)
        if stated is None:
            endings = ".tif, .png, .jpg, .webp, .avif or .jp2"
            raise ValueError(f"it has to end in {_ENDING}, or in {endings}")
        if self._form not in {None, stated}:
            raise ValueError(f"it ends in {suffix}, which is another format than --format names")


def _checked_parts(text: str) -> tuple[str, ...]:
    """Check the fields of a template, and return its parts between the separators."""
    for _, field in _parsed(text):
        if field is not None and field not in FIELDS:
            raise ValueError(
                f"{{{field}}} is no field; there are {_NAMES}, and {{{{ is a brace of the name"
            )
    return Path(text).parts


def _parsed(text: str) -> list[tuple[str, str | None]]:
    """Return the literal texts of a template, each with the field that follows it."""
    try:
        parsed = list(string.Formatter().parse(text))
    except ValueError:
        raise ValueError(
            f"a brace stands alone; there are {_NAMES}, and {{{{ is a brace of the name"
        ) from None
    pieces: list[tuple[str, str | None]] = []
    for literal, field, spec, conversion in parsed:
        written = field
        if field is not None and (spec or conversion):  # a field has no format of its own
            written = f"{field}{f'!{conversion}' if conversion else ''}{f':{spec}' if spec else ''}"
        pieces.append((literal, written))
    return pieces
