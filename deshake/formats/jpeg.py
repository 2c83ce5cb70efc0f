"""JPEG in and out, with the camera's quantisation tables."""

from __future__ import annotations

import io
import itertools
import struct
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from PIL import Image
from PIL.JpegImagePlugin import JpegImageFile, get_sampling

from deshake.errors import PhotoError
from deshake.formats.encoding import Decoded, Encoding, check_size, decoding
from deshake.formats.jpeg_frame import frame_of, with_frame
from deshake.metadata.density import exif_density, jfif_density
from deshake.metadata.image_resources import iptc_of, with_iptc
from deshake.metadata.metadata import Metadata
from deshake.metadata.xmp import guid

if TYPE_CHECKING:
    from collections.abc import Iterator

    from deshake.formats.transfer import Codes

__all__ = ["decode_jpeg", "encode_jpeg"]

_EXIF: Final = b"Exif\0\0"
_XMP: Final = b"http://ns.adobe.com/xap/1.0/\0"
_EXTENDED_XMP: Final = b"http://ns.adobe.com/xmp/extension/\0"
_RESOURCES: Final = b"Photoshop 3.0\0"
_ICC: Final = b"ICC_PROFILE\0"
_GAIN_MAPS: Final = (b"hdrgm:Version", b"HDRGainMap")  # marks in the XMP of the second picture
_MAX_SEGMENT: Final = 65533

Segments = list[tuple[str, bytes]]


def decode_jpeg(data: bytes, *, luma: bool = False) -> Decoded:
    """Decode a JPEG; of several pictures in one file (MPO, gain maps), the first.

    With `luma` the colours are not decoded: the picture is grey.

    Raises
    ------
    PhotoError
        If the file is damaged or cut short, too large, or neither grey nor RGB.

    """
    with decoding("JPEG"):
        picture = JpegImageFile(io.BytesIO(data))
        check_size(picture.height, picture.width, len(data))
        if picture.mode not in {"L", "RGB"}:
            raise PhotoError(
                f"a {picture.mode} JPEG: only grey and RGB photos can be deblurred",
                hint="convert it to RGB with its colour profile first",
            )
        if luma:
            picture.draft("L", picture.size)
        codes = np.asarray(picture)
        tables: dict[int, list[int]] = picture.quantization
        encoding = Encoding(
            "JPEG",
            grey=picture.mode == "L",
            quantisation=tuple(tuple(table) for _, table in sorted(tables.items())),
            subsampling=max(0, get_sampling(picture)),
            progressive=bool(picture.info.get("progressive")),
            carried=b"".join(_unchanged(*item) for item in picture.applist),
        )
        metadata = _metadata(picture.applist)
    lost = b"HasExtendedXMP" in metadata.xmp and not metadata.extended_xmp
    notes = ["its extended XMP is damaged, and left out"] if lost else []
    if any(mark in data for mark in _GAIN_MAPS):
        notes.append("its gain map (HDR) is dropped")
    frame = b"" if luma else frame_of(data)
    return Decoded(codes, None, encoding, metadata, notes=tuple(notes), frame=frame)


def encode_jpeg(picture: Decoded) -> bytes:
    """Encode 8-bit codes without alpha as JPEG, or copy the frame if there is one.

    Raises
    ------
    PhotoError
        If a side is longer than JPEG can hold.

    """
    encoding, metadata = picture.encoding, picture.metadata
    if max(picture.codes.shape[:2]) > 65500:
        raise PhotoError("a JPEG has at most 65500 pixels a side", hint="write a PNG or TIFF")
    options: dict[str, Any] = {
        "progressive": encoding.progressive,
        "subsampling": encoding.subsampling,
        "extra": encoding.carried + b"".join(_further(metadata)),
    }
    if encoding.quantisation:
        options["qtables"] = _tables(picture.codes, encoding)
    else:
        options["quality"] = encoding.quality
    if metadata.exif:
        options["exif"] = _EXIF + metadata.exif
    if metadata.xmp:
        options["xmp"] = metadata.xmp
    if metadata.icc:
        options["icc_profile"] = metadata.icc
    stream = io.BytesIO()
    codes = picture.codes[:8, :8] if picture.frame else picture.codes
    Image.fromarray(codes).save(stream, "JPEG", **options)
    data = stream.getvalue()
    density = metadata.density or exif_density(metadata.exif)
    if density is not None:
        data = density.in_jfif(data)
    return with_frame(data, picture.frame) if picture.frame else data


def _tables(codes: Codes, encoding: Encoding) -> list[list[int]]:
    """Return the tables for the encoder: a grey photo uses the first one alone."""
    tables = [list(table) for table in encoding.quantisation]
    return tables[:1] if codes.ndim == 2 else tables


def _metadata(segments: Segments) -> Metadata:
    """Sort the segments; of several segments of a kind that should be single, the first counts."""

    def parts(marker: str, head: bytes) -> list[bytes]:
        return [
            data[len(head) :]
            for name, data in segments
            if (name, data[: len(head)]) == (marker, head)
        ]

    exif, packets = parts("APP1", _EXIF), parts("APP1", _XMP)
    packet = packets[0] if packets else b""
    resources = b"".join(parts("APP13", _RESOURCES))
    return Metadata(
        exif=b"".join([*exif[:1], *itertools.takewhile(_continues, exif[1:])]),
        xmp=packet,
        icc=_profile(parts("APP2", _ICC)),
        iptc=iptc_of(resources),
        resources=resources,
        extended_xmp=_extended_xmp(parts("APP1", _EXTENDED_XMP), guid(packet, b"")),
        density=next((jfif_density(data) for name, data in segments if name == "APP0"), None),
    )


def _continues(exif: bytes) -> bool:
    """Return whether an EXIF segment continues the one before: it has no header of its own."""
    return exif[:4] not in {b"II*\0", b"MM\0*"}


def _profile(parts: list[bytes]) -> bytes:
    """Join the parts of the first complete colour profile."""
    numbered: dict[int, bytes] = {}
    for part in parts:
        if len(part) > 2 and 1 <= part[0] <= part[1]:
            numbered.setdefault(part[0], part[2:])
            if len(numbered) == part[1]:
                return b"".join(numbered[number] for number in sorted(numbered))
    return b""


def _extended_xmp(parts: list[bytes], name: bytes) -> bytes:
    """Join the parts of an extended XMP packet; empty if any is missing."""
    whole: dict[int, bytes] = {}
    length = 0
    for part in parts:
        if part[:32] == name and len(part) > 40:
            length, offset = struct.unpack_from(">II", part, 32)
            whole[offset] = part[40:]
    joined = b"".join(whole[offset] for offset in sorted(whole))
    return joined if len(joined) == length else b""


def _further(metadata: Metadata) -> Iterator[bytes]:
    """Make the segments of image resources and extended XMP."""
    resources = metadata.resources
    if metadata.iptc:
        resources = with_iptc(resources, metadata.iptc)
    for piece in _pieces(resources, _MAX_SEGMENT - len(_RESOURCES)):
        yield _segment(0xED, _RESOURCES + piece)
    more = metadata.extended_xmp
    head = _EXTENDED_XMP + guid(metadata.xmp, more)
    offset = 0
    for piece in _pieces(more, _MAX_SEGMENT - len(head) - 8):
        yield _segment(0xE1, head + struct.pack(">II", len(more), offset) + piece)
        offset += len(piece)


def _pieces(data: bytes, size: int) -> Iterator[bytes]:
    return (data[at : at + size] for at in range(0, len(data), size))


def _segment(marker: int, content: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content


def _unchanged(name: str, content: bytes) -> bytes:
    """Return a segment that is copied unchanged: a comment, old image resources; else nothing."""
    if name == "COM":
        return _segment(0xFE, content)
    old = name == "APP13" and not content.startswith(_RESOURCES)
    return _segment(0xED, content) if old else b""
