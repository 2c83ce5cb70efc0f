"""The size of a picture, from its file's header: known before the picture is decoded."""

from __future__ import annotations

import contextlib
import os
import warnings
from pathlib import Path
from typing import NamedTuple

import tifffile
from PIL import Image

from deshake.formats.encoding import READ_ONLY

__all__ = ["PictureSize", "picture_size"]

_GREY = {"1", "L", "LA", "I", "I;16", "I;16B", "I;16L", "F"}
_PIXELS_A_BYTE = 8
"""Of a file with an unknown header; phones' HEIC files hold fewer."""


class PictureSize(NamedTuple):
    """Pixels and colour channels of a picture."""

    pixels: int
    channels: int


def picture_size(path: str | os.PathLike[str]) -> PictureSize | None:
    """Return the size of a picture, without decoding it; None: it is no picture.

    If no library knows the header, the size of the file gives a rough estimate, rather too large.
    """
    if READ_ONLY.get(Path(path).suffix.lower()) == "RAW":  # the others read its small preview
        with contextlib.suppress(Exception):
            return _by_rawpy(path)
    with warnings.catch_warnings(), contextlib.suppress(Exception):
        warnings.simplefilter("ignore")  # reading the photo reports what is wrong
        return _by_pillow(path)
    with contextlib.suppress(Exception):
        return _by_tifffile(path)
    try:
        size = os.stat(path).st_size  # noqa: PTH116
    except OSError:
        return None
    return PictureSize(_PIXELS_A_BYTE * size, 3) if size else None


def _by_pillow(path: str | os.PathLike[str]) -> PictureSize:
    with Image.open(path) as image:
        return PictureSize(image.width * image.height, 1 if image.mode in _GREY else 3)


def _by_rawpy(path: str | os.PathLike[str]) -> PictureSize:
    import rawpy  # noqa: PLC0415 - needed for RAW files alone

    with rawpy.imread(os.fspath(path)) as raw:
        return PictureSize(raw.sizes.raw_width * raw.sizes.raw_height, 3)


def _by_tifffile(path: str | os.PathLike[str]) -> PictureSize:
    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        return PictureSize(page.imagelength * page.imagewidth, min(page.samplesperpixel, 3))
