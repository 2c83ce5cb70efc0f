"""From one format to another: which format is written, how, and what is lost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deshake.errors import OutputError
from deshake.formats.encoding import READ_ONLY, SUFFIXES, WRITTEN_AS, Encoding
from deshake.formats.transfer import encode

if TYPE_CHECKING:
    import os

    from numpy.typing import NDArray

    from deshake.formats.encoding import Format
    from deshake.formats.transfer import Codes

__all__ = ["check_ending", "converted", "encoded", "lost", "output_format"]

_TEXTS = (b"tEXt", b"zTXt", b"iTXt")
_BAND = 256  # rows whose colours are converted at once


def output_format(path: str | os.PathLike[str], source: Path, encoding: Encoding) -> Format:
    """Return the format in which a photo is written to a file of this name.

    If the name has the source's ending, it is the photo's own format; else the ending decides.

    Raises
    ------
    OutputError
        If the ending stands for no format that deshake writes.

    """
    own = encoding.format not in WRITTEN_AS
    check_ending(path, source if own else None)
    suffix = Path(path).suffix.lower()
    if own and suffix == source.suffix.lower():
        return encoding.format
    return SUFFIXES[suffix]


def check_ending(path: str | os.PathLike[str], source: str | os.PathLike[str] | None) -> None:
    """Check that a name's ending stands for a format that deshake writes.

    Parameters
    ----------
    path : path
        The name.
    source : path or None
        A photo: its ending stands for its own format, even if it is unusual.

    Raises
    ------
    OutputError
        If it stands for no such format.

    """
    suffix = Path(path).suffix.lower()
    hint = "use .tif, .png, .jpg, .webp, .avif or .jp2"
    if suffix in READ_ONLY:
        raise OutputError(
            f"{READ_ONLY[suffix]} files are read, but not written", hint=hint, file=path
        )
    own = source is not None and suffix == Path(source).suffix.lower()
    if not suffix and not own:
        hint = f"{hint}; the name of a folder ends with a slash: {path}/"
        raise OutputError("the name has no ending", hint=hint, file=path)
    if suffix not in SUFFIXES and not own:
        raise OutputError(f"no photo format ends in {suffix!r}", hint=hint, file=path)


def converted(encoding: Encoding, form: Format) -> Encoding:
    """Return how to write another format: lossless and compressed where possible.

    More than 8 bits stay 16, or become 10 in an AVIF.
    """
    deep = encoding.depth > 8 and form in {"PNG", "TIFF", "AVIF", "JPEG2000"}
    return Encoding(
        form,
        depth=16 if deep else 8,
        bits=10 if deep and form == "AVIF" else 0,
        grey=encoding.grey,
        transfer=encoding.transfer,
        quality=encoding.quality,
        matrix=encoding.matrix,
        lossless=encoding.format == "PNG",
        compressed=True,
    )


def encoded(pixels: NDArray[np.float32], encoding: Encoding) -> Codes:
    """Encode pixels in the file's colours; a matrix works on one band of rows at a time."""
    if encoding.matrix is None or pixels.ndim == 2:
        return encode(pixels, encoding.transfer, encoding.depth)
    matrix = np.array(encoding.matrix, np.float32)
    bands = [
        encode(pixels[top : top + _BAND] @ matrix.T, encoding.transfer, encoding.depth)
        for top in range(0, len(pixels), _BAND)
    ]
    return np.concatenate(bands)


def lost(encoding: Encoding, form: Format) -> list[str]:
    """Report what a photo loses if it is written in a format that is not its own."""
    if form != encoding.format and (
        (encoding.format == "JPEG" and encoding.carried)
        or (encoding.format == "PNG" and any(name in encoding.carried for name in _TEXTS))
    ):
        return [f"its texts, beside EXIF, XMP and IPTC, are left out of a {form}"]
    if encoding.format == "HEIF" and form == "JPEG":
        bits = f" of {encoding.bits} bits" if encoding.bits else ""
        written = f"a JPEG of quality {encoding.quality}"
        return [f"a HEIC{bits}, written as {written} (-o NAME.tif loses nothing)"]
    if encoding.depth == 32 and form != "TIFF":
        return ["what lies beyond white is cut off (-o NAME.tif keeps it)"]
    return []
