"""A photo's file: encoded in its own format or another, and written whole or not at all."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from deshake.errors import PhotoError
from deshake.files.disk import check_output, write_bytes
from deshake.formats.avif import encode_avif
from deshake.formats.carrying import carried
from deshake.formats.conversion import converted, encoded, output_format
from deshake.formats.encoding import SUFFIXES, WRITTEN_AS, Decoded
from deshake.formats.jpeg import encode_jpeg
from deshake.formats.jpeg2000 import encode_jpeg2000
from deshake.formats.png import encode_png
from deshake.formats.tiff import encode_tiff
from deshake.formats.transfer import Power
from deshake.formats.webp import encode_webp
from deshake.metadata.profiles import power_profile

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Sequence

    from deshake.formats.encoding import Format
    from deshake.formats.photo import Photo

__all__ = ["encode_photo", "photo_bytes", "write_photo"]

_log = logging.getLogger(__name__)

_ENCODERS: dict[Format, Callable[[Decoded], bytes]] = {
    "JPEG": encode_jpeg,
    "PNG": encode_png,
    "TIFF": encode_tiff,
    "WEBP": encode_webp,
    "AVIF": encode_avif,
    "JPEG2000": encode_jpeg2000,
}


def encode_photo(photo: Photo, form: Format | None = None) -> bytes:
    """Encode a photo, by default in the format and depth of its file.

    Parameters
    ----------
    photo : Photo
        The photo. If the pixels of a JPEG are unchanged, its compressed picture is copied.
    form : Format, optional
        Another format. JPEG and WebP hold 8 bits; WebP holds grey as RGB. deshake does not write
        RAW and HEIC: by default, RAW becomes TIFF, and HEIC becomes JPEG.

    Raises
    ------
    PhotoError
        If the format cannot hold the photo: its size, its metadata, or transparency in a JPEG.

    """
    encoding, alpha = photo.encoding, photo.alpha
    if encoding.format in WRITTEN_AS:
        form = form or SUFFIXES[WRITTEN_AS[encoding.format]]
    metadata = photo.metadata
    if form is not None and form != encoding.format:
        encoding = converted(encoding, form)
        if not metadata.icc and isinstance(encoding.transfer, Power):  # a PNG states it elsewhere
            profile = power_profile(encoding.transfer.gamma, grey=encoding.grey)
            metadata = replace(metadata, icc=profile)
        if alpha is not None and alpha.dtype == np.uint16 and encoding.depth == 8:
            alpha = np.rint(alpha / 257).astype(np.uint8)
    if alpha is not None and encoding.format == "JPEG":
        if alpha.min() < np.iinfo(alpha.dtype).max:
            raise PhotoError(
                "a JPEG cannot hold transparency",
                hint="write a PNG, TIFF or WebP",
                file=photo.source,
            )
        alpha = None
    frame = photo.frame.of(photo.pixels) if photo.frame and encoding.format == "JPEG" else b""
    codes = encoded(photo.pixels, encoding)
    metadata = carried(metadata, encoding.format, *photo.shape).metadata
    try:
        return _ENCODERS[encoding.format](Decoded(codes, alpha, encoding, metadata, frame=frame))
    except PhotoError as error:
        error.file = str(photo.source)
        raise


def write_photo(
    path: str | os.PathLike[str],
    photo: Photo,
    *,
    overwrite: bool = False,
    made_from: Sequence[str | os.PathLike[str]] | None = None,
) -> None:
    """Write a photo to a file, whole or not at all; warn of metadata that it cannot hold.

    Parameters
    ----------
    path : path
        The file; `output_format` decides its format.
    photo : Photo
        The photo.
    overwrite : bool, keyword-only
        Whether an existing file may be replaced. The photo's source never is.
    made_from : sequence of path, keyword-only
        The inputs, whose permissions the file takes; by default the photo's source. Without inputs
        the system decides.

    Raises
    ------
    OutputError
        If the file may not or cannot be written.
    PhotoError
        If the format cannot hold the photo.

    """
    check_output(path, photo.source, overwrite=overwrite)
    data = photo_bytes(path, photo)
    inputs = [photo.source] if made_from is None else made_from
    write_bytes(path, data, overwrite=overwrite, made_from=inputs)


def photo_bytes(path: str | os.PathLike[str], photo: Photo, form: Format | None = None) -> bytes:
    """Return the bytes of a photo's file; warn of metadata that the format cannot hold.

    Parameters
    ----------
    path : path
        Name of the file; `output_format` decides its format.
    photo : Photo
        The photo.
    form : Format, optional
        A format, whatever the name is.

    Raises
    ------
    OutputError
        If the name's ending stands for no format that deshake writes.
    PhotoError
        If the format cannot hold the photo.

    """
    form = form or output_format(path, photo.source, photo.encoding)
    for loss in carried(photo.metadata, form, *photo.shape).losses:
        _log.warning("%s: %s", photo.source, loss)
    return encode_photo(photo, form)
