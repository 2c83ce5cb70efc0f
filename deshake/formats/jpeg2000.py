"""JPEG 2000 in and out, 8 and 16 bits, lossless.

OpenCV decodes and encodes the pixels. The boxes around them are read and written here: colour
profile, EXIF, XMP, and others, which are carried as they are.

References
----------
.. [1] ISO/IEC 15444-1, JPEG 2000, Annexes A and I.

"""

from __future__ import annotations

import struct
from typing import Final

import cv2
import numpy as np

from deshake.errors import PhotoError
from deshake.formats.boxes import read_boxes
from deshake.formats.encoding import DAMAGED, Decoded, Encoding, check_size, decoding
from deshake.formats.opencv import imdecode, imencode
from deshake.metadata.metadata import Metadata

__all__ = ["decode_jpeg2000", "encode_jpeg2000"]

_EXIF: Final = b"JpgTiffExif->JP2"
_XMP: Final = bytes.fromhex("be7acfcb97a942e89c71999491e3afac")
_CARRIED: Final = (b"uuid", b"xml ", b"uinf")
_STREAM: Final = b"\xff\x4f\xff\x51"  # start of the code stream, and of its size segment
_END: Final = b"\xff\xd9"
_ICC_METHODS: Final = (2, 3)
_COLOURS: Final = (16, 17, 18)  # sRGB, grey, sYCC
_LOSSLESS: Final = (cv2.IMWRITE_JPEG2000_COMPRESSION_X1000, 1000)
_LEAST: Final = 32  # pixels a side that the encoder's five resolutions need


def decode_jpeg2000(data: bytes) -> Decoded:
    """Decode a JP2 file, or a bare code stream. 9 to 15 bits become 16.

    Raises
    ------
    PhotoError
        If the file is damaged or cut short, too large, or neither grey nor RGB.

    """
    with decoding("JPEG 2000"):
        boxes = [(b"jp2c", data)] if data.startswith(_STREAM) else list(_boxes(data))
        stream = next((content for name, content in boxes if name == b"jp2c"), b"")
        height, width, bits, count = _size(stream)
        check_size(height, width, len(data))
        icc = b""
        for name, content in boxes:
            if name == b"colr":
                icc = icc or _profile(content)
        pixels = np.atleast_3d(imdecode(data))
        if pixels.shape != (height, width, count):
            raise PhotoError("an unusual kind of JPEG 2000", hint="convert it to TIFF first")
        uuids = {content[:16]: content[16:] for name, content in boxes if name == b"uuid"}
        carried = b"".join(
            _box(name, content)
            for name, content in boxes
            if name in _CARRIED and content[:16] not in {_EXIF, _XMP}
        )
    if bits > 8:
        pixels = np.rint(pixels * (65535 / ((1 << bits) - 1))).astype(np.uint16)
    else:
        pixels = np.rint(pixels * (255 / ((1 << bits) - 1))).astype(np.uint8)
    grey = count == 1
    metadata = Metadata(uuids.get(_EXIF, b"").removeprefix(b"Exif\0\0"), uuids.get(_XMP, b""), icc)
    return Decoded(
        np.ascontiguousarray(pixels[..., 0] if grey else pixels[..., :3]),
        np.ascontiguousarray(pixels[..., 3]) if count == 4 else None,
        Encoding("JPEG2000", depth=16 if bits > 8 else 8, grey=grey, carried=carried),
        metadata,
    )


def encode_jpeg2000(picture: Decoded) -> bytes:
    """Encode codes of 8 or 16 bits as JP2, lossless.

    Raises
    ------
    PhotoError
        If a side is shorter than 32 pixels.

    """
    codes, metadata = picture.codes, picture.metadata
    if min(codes.shape[:2]) < _LEAST:
        raise PhotoError(
            f"a JPEG 2000 is written with at least {_LEAST} pixels a side",
            hint="write a PNG or TIFF",
        )
    if picture.alpha is not None:
        colours = codes if codes.ndim == 3 else np.dstack([codes] * 3)
        codes = np.dstack([colours, picture.alpha]).astype(codes.dtype)
    written = imencode(".jp2", codes, _LOSSLESS)
    out = b""
    for name, start, end in read_boxes(written):
        content = written[start:end]
        if name == b"jp2h" and metadata.icc:
            content = _with_profile(content, metadata.icc)
        out += _box(name, content)
        if name == b"jp2h":
            out += picture.encoding.carried
            for key, block in ((_EXIF, metadata.exif), (_XMP, metadata.xmp)):
                out += _box(b"uuid", key + block) if block else b""
    return out


def _boxes(data: bytes) -> list[tuple[bytes, bytes]]:
    """Return the boxes of a file; the boxes inside the header replace the header."""
    contents = []
    for name, start, end in read_boxes(data):
        if name == b"jp2h":
            contents += [(inner, data[a:b]) for inner, a, b in read_boxes(data, start, end)]
        else:
            contents.append((name, data[start:end]))
    return contents


def _box(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", len(content) + 8, name) + content


def _size(stream: bytes) -> tuple[int, int, int, int]:
    """Return height, width, bits a sample and the number of channels of a code stream.

    A code stream without its end marker is refused: the decoder would leave the rest blank.
    """
    if not stream.startswith(_STREAM) or not stream.rstrip(b"\0").endswith(_END):
        raise PhotoError("the JPEG 2000 is damaged or cut short", hint=DAMAGED)
    x, y, left, top = struct.unpack_from(">4I", stream, 8)
    (count,) = struct.unpack_from(">H", stream, 40)
    samples = {stream[42 + 3 * index : 45 + 3 * index] for index in range(min(count, 5))}
    if len(samples) != 1 or count not in {1, 3, 4}:
        raise PhotoError("an unusual kind of JPEG 2000", hint="convert it to TIFF first")
    depth, across, down = samples.pop()
    bits = (depth & 0x7F) + 1
    if depth & 0x80 or not 2 <= bits <= 16 or (across, down) != (1, 1):
        raise PhotoError("an unusual kind of JPEG 2000", hint="convert it to TIFF first")
    return y - top, x - left, bits, count


def _profile(content: bytes) -> bytes:
    """Return the profile in a colour box; refuse colours that are neither grey nor RGB."""
    if content[0] in _ICC_METHODS:
        return content[3:]
    if content[0] == 1 and struct.unpack_from(">I", content, 3)[0] not in _COLOURS:
        raise PhotoError(
            "a JPEG 2000 that is neither grey nor RGB",
            hint="convert it to RGB with its colour profile first",
        )
    return b""


def _with_profile(header: bytes, icc: bytes) -> bytes:
    """Put a profile in place of the header's colour box."""
    return b"".join(
        _box(name, b"\2\0\0" + icc if name == b"colr" else header[start:end])
        for name, start, end in read_boxes(header)
    )
