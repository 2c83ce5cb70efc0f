"""JPEG in and out, with the tables that the camera used."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from PIL import Image
from PIL.JpegImagePlugin import JpegImageFile, get_sampling

from deshake.errors import PhotoError
from deshake.io.encoding import Decoded, Encoding, check_size, decoding
from deshake.io.metadata import Metadata

if TYPE_CHECKING:
    from deshake.io.transfer import Codes

__all__ = ["decode_jpeg", "encode_jpeg"]

_EXIF: Final = b"Exif\0\0"
_XMP: Final = b"http://ns.adobe.com/xap/1.0/\0"
_EXTENDED_XMP: Final = b"http://ns.adobe.com/xmp/extension/\0"
_QUALITY: Final = 95  # for photos that were no JPEG before
_MAX_SEGMENT: Final = 65533


def decode_jpeg(data: bytes) -> Decoded:
    """Decode a JPEG; of several pictures in one file (MPO, gain maps), the first.

    Raises
    ------
    PhotoError
        If the file is damaged or cut short, too large, or neither grey nor RGB.

    """
    with decoding("JPEG"):
        picture = JpegImageFile(io.BytesIO(data))
        check_size(picture.height, picture.width)
        if picture.mode not in {"L", "RGB"}:
            raise PhotoError(
                f"a {picture.mode} JPEG: only grey and RGB photos can be deblurred",
                hint="convert it to RGB with its colour profile first",
            )
        codes = np.asarray(picture)
        tables: dict[int, list[int]] = picture.quantization
        encoding = Encoding(
            "JPEG",
            grey=picture.mode == "L",
            quantisation=tuple(tuple(table) for _, table in sorted(tables.items())),
            subsampling=max(0, get_sampling(picture)),
            progressive=bool(picture.info.get("progressive")),
            carried=b"".join(_segment(*item) for item in picture.applist),
        )
        metadata = Metadata(
            exif=picture.info.get("exif", b"").removeprefix(_EXIF),
            xmp=picture.info.get("xmp", b""),
            icc=picture.info.get("icc_profile") or b"",
        )
    return Decoded(codes, None, encoding, metadata)


def encode_jpeg(picture: Decoded) -> bytes:
    """Encode 8-bit codes as JPEG; alpha must be gone.

    Raises
    ------
    PhotoError
        If a side is longer, or a metadata block larger, than JPEG can hold.

    """
    encoding, metadata = picture.encoding, picture.metadata
    if max(picture.codes.shape[:2]) > 65500:
        raise PhotoError("a JPEG has at most 65500 pixels a side", hint="write a PNG or TIFF")
    if len(metadata.exif) > _MAX_SEGMENT - len(_EXIF):
        raise PhotoError("the EXIF block does not fit into a JPEG", hint="write a PNG or TIFF")
    if len(metadata.xmp) > _MAX_SEGMENT - len(_XMP):
        raise PhotoError("the XMP packet does not fit into a JPEG", hint="write a PNG or TIFF")
    options: dict[str, Any] = {
        "progressive": encoding.progressive,
        "subsampling": encoding.subsampling,
        "extra": encoding.carried,
    }
    if encoding.quantisation:
        options["qtables"] = _tables(picture.codes, encoding)
    else:
        options["quality"] = _QUALITY
    if metadata.exif:
        options["exif"] = _EXIF + metadata.exif
    if metadata.xmp:
        options["xmp"] = metadata.xmp
    if metadata.icc:
        options["icc_profile"] = metadata.icc
    stream = io.BytesIO()
    Image.fromarray(picture.codes).save(stream, "JPEG", **options)
    return stream.getvalue()


def _tables(codes: Codes, encoding: Encoding) -> list[list[int]]:
    """Return the tables to encode with: a grey photo uses the first alone."""
    tables = [list(table) for table in encoding.quantisation]
    return tables[:1] if codes.ndim == 2 else tables


def _segment(name: str, content: bytes) -> bytes:
    """Return a segment to carry over (IPTC, extended XMP, comment) with its marker, or nothing."""
    marker = {"APP13": b"\xff\xed", "COM": b"\xff\xfe"}.get(name)
    if name == "APP1" and content.startswith(_EXTENDED_XMP):
        marker = b"\xff\xe1"
    return b"" if marker is None else marker + struct.pack(">H", len(content) + 2) + content
