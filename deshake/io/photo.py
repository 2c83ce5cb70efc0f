"""A photo: pixels in linear light, and all that is needed to write it back the same way."""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deshake.errors import OutputError, PhotoError
from deshake.io.carrying import carried
from deshake.io.encoding import SUFFIXES, Decoded, Encoding
from deshake.io.files import check_output, read_bytes, write_bytes
from deshake.io.icc import profile_transfer
from deshake.io.jpeg import decode_jpeg, encode_jpeg
from deshake.io.png import SIGNATURE, decode_png, encode_png
from deshake.io.tiff import decode_tiff, encode_tiff
from deshake.io.transfer import NAMED, decode, encode, is_clipped
from deshake.io.webp import decode_webp, encode_webp

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from deshake.io.encoding import Format
    from deshake.io.metadata import Metadata
    from deshake.io.transfer import Codes, TransferName

__all__ = ["Photo", "encode_photo", "output_format", "read_photo", "write_photo"]

_log = logging.getLogger(__name__)

_MAX_BYTES = 4 << 30
_DECODERS: dict[Format, Callable[[bytes], Decoded]] = {
    "JPEG": decode_jpeg,
    "PNG": decode_png,
    "TIFF": decode_tiff,
    "WEBP": decode_webp,
}
_ENCODERS: dict[Format, Callable[[Decoded], bytes]] = {
    "JPEG": encode_jpeg,
    "PNG": encode_png,
    "TIFF": encode_tiff,
    "WEBP": encode_webp,
}
_TIFF_MARKS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo, upright, in linear light.

    Parameters
    ----------
    pixels : (H, W) or (H, W, 3) array of float32
        Linear light; 1 is the file's white, where it clips. Results may exceed [0, 1]: they are
        clipped when they are encoded.
    clipped : (H, W) array of bool
        Where any channel of the input was at the top (see `transfer.is_clipped`).
    alpha : (H, W) array of uint8 or uint16, or None
        Opacity in the file's depth; carried bit for bit.
    encoding : Encoding
        How the file held the pixels.
    metadata : Metadata
        EXIF, XMP and ICC, with the orientation set to 1.
    source : Path
        The file.

    """

    pixels: NDArray[np.float32]
    clipped: NDArray[np.bool_]
    alpha: Codes | None
    encoding: Encoding
    metadata: Metadata
    source: Path

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.pixels.shape[0], self.pixels.shape[1]

    def with_pixels(self, pixels: NDArray[np.floating]) -> Photo:
        """Return the photo with other pixels of the same shape.

        Raises
        ------
        ValueError
            If the shape differs.

        """
        if pixels.shape != self.pixels.shape:
            msg = f"pixels of shape {pixels.shape} for a photo of shape {self.pixels.shape}"
            raise ValueError(msg)
        return replace(self, pixels=np.asarray(pixels, np.float32))


def read_photo(path: str | os.PathLike[str], *, transfer: TransferName | None = None) -> Photo:
    """Read a JPEG, PNG, TIFF or WebP file, whatever its name says.

    The EXIF orientation is applied to the pixels and set to 1.

    Parameters
    ----------
    path : path
        The file.
    transfer : {"srgb", "linear", "gamma22"}, optional, keyword-only
        The file's transfer curve. By default that of its ICC profile if it has a simple one,
        else what a PNG's gAMA chunk says, else sRGB.

    Raises
    ------
    PhotoError
        If there is no such file, it is none of the four formats, damaged or cut short, has more
        than one picture, more than `encoding.MAX_PIXELS` pixels, or no grey or RGB integers.

    """
    if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):  # noqa: PTH110, PTH112, PTH113
        raise PhotoError("is not a regular file", file=path)
    data = read_bytes(path, _MAX_BYTES, PhotoError)
    try:
        decoded = _DECODERS[_sniff(data)](data)
    except PhotoError as error:
        error.file = os.fspath(path)
        raise
    turn = decoded.metadata.orientation
    codes = _turn(decoded.codes, turn)
    clipped = is_clipped(codes)
    curve = NAMED[transfer] if transfer is not None else profile_transfer(decoded.metadata.icc)
    encoding = decoded.encoding if curve is None else replace(decoded.encoding, transfer=curve)
    return Photo(
        pixels=decode(codes, encoding.transfer),
        clipped=clipped if encoding.grey else np.any(clipped, axis=-1),
        alpha=None if decoded.alpha is None else _turn(decoded.alpha, turn),
        encoding=encoding,
        metadata=decoded.metadata.upright(),
        source=Path(path),
    )


def encode_photo(photo: Photo, form: Format | None = None) -> bytes:
    """Encode a photo, by default in the format and depth of its file.

    Parameters
    ----------
    photo : Photo
        The photo.
    form : {"JPEG", "PNG", "TIFF", "WEBP"}, optional
        Another format. JPEG and WebP hold 8 bits; WebP holds grey as RGB.

    Raises
    ------
    PhotoError
        If the format cannot hold the photo: its size, its metadata, or transparency in a JPEG.

    """
    encoding, alpha = photo.encoding, photo.alpha
    if form is not None and form != encoding.format:
        encoding = _converted(encoding, form)
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
    codes = encode(photo.pixels, encoding.transfer, encoding.depth)
    metadata = carried(photo.metadata, encoding.format, *photo.shape).metadata
    try:
        return _ENCODERS[encoding.format](Decoded(codes, alpha, encoding, metadata))
    except PhotoError as error:
        error.file = str(photo.source)
        raise


def output_format(path: str | os.PathLike[str], photo: Photo) -> Format:
    """Return the format to write under a name.

    The photo's own, if the name ends as the source's does; else the one that the ending means.

    Raises
    ------
    OutputError
        If the ending means none of the four formats.

    """
    suffix = Path(path).suffix.lower()
    if suffix == photo.source.suffix.lower():
        return photo.encoding.format
    if suffix not in SUFFIXES:
        raise OutputError(
            f"no photo format ends in {suffix!r}" if suffix else "the name has no ending",
            hint="use .jpg, .png, .tif or .webp",
            file=path,
        )
    return SUFFIXES[suffix]


def write_photo(path: str | os.PathLike[str], photo: Photo, *, overwrite: bool = False) -> None:
    """Write a photo to a file, whole or not at all; warn of metadata that it cannot hold.

    Parameters
    ----------
    path : path
        The file; `output_format` decides its format.
    photo : Photo
        The photo.
    overwrite : bool, keyword-only
        Whether an existing file may be replaced. The photo's source never is.

    Raises
    ------
    OutputError
        If the file may not or cannot be written.
    PhotoError
        If the format cannot hold the photo.

    """
    form = output_format(path, photo)
    check_output(path, photo.source, overwrite=overwrite)
    for loss in carried(photo.metadata, form, *photo.shape).losses:
        _log.warning("%s: %s", photo.source, loss)
    write_bytes(path, encode_photo(photo, form), overwrite=overwrite)


def _sniff(data: bytes) -> Format:
    """Tell the format by the first bytes."""
    if data.startswith(b"\xff\xd8\xff"):
        return "JPEG"
    if data.startswith(SIGNATURE):
        return "PNG"
    if data.startswith(_TIFF_MARKS):
        return "TIFF"
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "WEBP"
    if not data:
        raise PhotoError("the file is empty")
    if data.startswith(b"GIF8"):
        raise PhotoError(
            "a GIF, whose 256 colours are too few to deblur",
            hint="start from the photo as the camera wrote it",
        )
    if data[4:8] == b"ftyp":
        raise PhotoError(
            "a HEIC, AVIF or video file", hint="convert the photo to JPEG or TIFF first"
        )
    raise PhotoError("not a JPEG, PNG, TIFF or WebP file", hint="name a photo")


def _turn(array: Codes, orientation: int) -> Codes:
    """Turn an array (H, W, ...) as stored to upright, by its EXIF orientation."""
    if orientation >= 5:  # rows and columns change places first
        array = array.swapaxes(0, 1)
    if orientation in {3, 4, 7, 8}:
        array = array[::-1]
    if orientation in {2, 3, 6, 7}:
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


def _converted(encoding: Encoding, form: Format) -> Encoding:
    """Return the way to write another format: lossless and compressed where it can be."""
    return Encoding(
        form,
        depth=encoding.depth if form in {"PNG", "TIFF"} else 8,
        grey=encoding.grey,
        transfer=encoding.transfer,
        lossless=encoding.format == "PNG",
        compressed=True,
    )
