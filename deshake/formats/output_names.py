"""The name of a result, beside its photo or in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from deshake.files.disk import check_output
from deshake.formats.encoding import READ_ONLY, WRITTEN_AS

if TYPE_CHECKING:
    import os

__all__ = ["default_output", "output_name"]


def output_name(source: str | os.PathLike[str]) -> str:
    """Return the default name of a photo's output: ``<stem>.deshaken.<ext>``.

    The ending is the photo's own. For a format that is only read, it is the ending of the format
    that replaces it.
    """
    path = Path(source)
    form = READ_ONLY.get(path.suffix.lower())
    return f"{path.stem}.deshaken{path.suffix if form is None else WRITTEN_AS[form]}"


def default_output(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    overwrite: bool = False,
) -> Path:
    """Decide where the result for one photo goes, and check that it can go there.

    Parameters
    ----------
    source : path
        The input photo.
    out : path, optional
        The user's choice: a file, or an existing folder for a file of the default name.
        By default ``<stem>.deshaken.<ext>`` beside the input.
    overwrite : bool, keyword-only
        Whether an existing output may be replaced.

    Returns
    -------
    Path
        The output file.

    Raises
    ------
    OutputError
        For the reasons of `check_output`.

    """
    if out is None:
        path = Path(source).with_name(output_name(source))
    elif Path(out).is_dir():
        path = Path(out) / output_name(source)
    else:
        path = Path(out)
    check_output(path, source, overwrite=overwrite)
    return path
