"""The name of a result, beside its photo or in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from deshake.files.disk import check_output
from deshake.formats.encoding import ENDINGS, READ_ONLY, SUFFIXES, WRITTEN_AS

if TYPE_CHECKING:
    import os

    from deshake.formats.encoding import Format

__all__ = ["default_output", "output_ending", "output_name"]


def output_name(source: str | os.PathLike[str], form: Format | None = None) -> str:
    """Return the default name of a photo's output: ``<stem>.deshaken.<ext>``.

    The ending is that of `output_ending`.
    """
    return f"{Path(source).stem}.deshaken{output_ending(source, form)}"


def output_ending(source: str | os.PathLike[str], form: Format | None = None) -> str:
    """Return the ending of the name of a photo's output, with its dot.

    It is the photo's own if it stands for the format of the output. Else it is the usual ending of
    that format.

    Parameters
    ----------
    source : path
        The photo.
    form : Format, optional
        The format of the output; by default the photo's own, or the one that replaces a format
        that is only read.

    """
    suffix = Path(source).suffix
    if form is None:
        read_only = READ_ONLY.get(suffix.lower())
        return suffix if read_only is None else WRITTEN_AS[read_only]
    return suffix if SUFFIXES.get(suffix.lower()) == form else ENDINGS[form]


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
