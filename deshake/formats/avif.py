"""AVIF in and out, with 8, 10 or 12 bits.

OpenCV decodes in full depth; Pillow reads the orientation, which OpenCV does not apply. Pillow
writes 8 bits without opacity, at quality 95. OpenCV writes more bits, and opacity, lossless.
"""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from PIL import Image
from PIL.AvifImagePlugin import AvifImageFile

from deshake.errors import PhotoError
from deshake.formats.boxes import item_properties, metadata_items
from deshake.formats.encoding import DAMAGED, Decoded, Encoding, check_stated_size, decoding, turned
from deshake.formats.opencv import imdecode, imencode
from deshake.metadata import exif
from deshake.metadata.metadata import Metadata
from deshake.metadata.profiles import cicp_profile

if TYPE_CHECKING:
    from deshake.formats.boxes import Item
    from deshake.formats.transfer import Codes

__all__ = ["decode_avif", "encode_avif"]

_QUALITY: Final = 95  # of 100, for 8 bits without opacity; others are lossless
_LOSSLESS: Final = 100
_SUBSAMPLING: Final = ("4:4:4", "4:2:2", "4:2:0")
_GAIN_MAP: Final = b"tmap"


def decode_avif(data: bytes) -> Decoded:
    """Decode a still AVIF of 8 bits to 8 bits, one of 10 or 12 bits to 16.

    Raises
    ------
    PhotoError
        If the file is damaged or cut short, too large, animated, or HDR.

    """
    with decoding("AVIF"):
        picture = AvifImageFile(io.BytesIO(data))
        check_stated_size(picture.height, picture.width, len(data))
        if getattr(picture, "n_frames", 1) > 1:
            raise PhotoError("an animated AVIF", hint="take one still picture out of it")
        properties = item_properties(data)
        bits, grey, subsampling = _configuration(properties)
        icc = picture.info.get("icc_profile", b"") or _profile_by_numbers(properties)
        turn = picture.getexif().get(exif.ORIENTATION, 1)
        items = metadata_items(data)
        metadata = Metadata(_exif(items), picture.info.get("xmp", b""), icc).upright()
        pixels = _pixels(_without(data, items), picture, bits)
        if pixels.shape[:2] != (picture.height, picture.width):
            raise PhotoError("the AVIF is damaged", hint=DAMAGED)
    if bits > 8:
        pixels = np.rint(pixels * (65535 / ((1 << bits) - 1))).astype(np.uint16)
    codes = turned(pixels[..., 0] if grey else pixels[..., :3], turn)
    encoding = Encoding(
        "AVIF",
        depth=16 if bits > 8 else 8,
        bits=bits if bits > 8 else 0,
        grey=grey,
        subsampling=subsampling,
    )
    alpha = turned(pixels[..., 3], turn) if pixels.shape[2] == 4 else None
    notes = ("its gain map (HDR) is dropped",) if _GAIN_MAP in data[:64] else ()
    return Decoded(codes, alpha, encoding, metadata, notes=notes)


def encode_avif(picture: Decoded) -> bytes:
    """Encode codes as AVIF of 8, 10 or 12 bits."""
    encoding, metadata = picture.encoding, picture.metadata
    codes = picture.codes
    if picture.alpha is not None:
        colours = codes if codes.ndim == 3 else np.dstack([codes] * 3)
        codes = np.dstack([colours, picture.alpha]).astype(codes.dtype)
    if encoding.depth == 8 and picture.alpha is None:
        stream = io.BytesIO()
        Image.fromarray(codes).save(
            stream,
            "AVIF",
            quality=_QUALITY,
            subsampling="4:0:0" if codes.ndim == 2 else _SUBSAMPLING[encoding.subsampling],
            exif=_Block(metadata.exif) if metadata.exif else None,
            xmp=metadata.xmp,
            icc_profile=metadata.icc,
        )
        return stream.getvalue()
    if encoding.depth > 8:
        codes = np.rint(codes * (((1 << encoding.bits) - 1) / 65535)).astype(np.uint16)
    options = (
        *(cv2.IMWRITE_AVIF_DEPTH, encoding.bits or 8),
        *(cv2.IMWRITE_AVIF_QUALITY, _LOSSLESS),
    )
    blocks = {
        cv2.IMAGE_METADATA_EXIF: metadata.exif,
        cv2.IMAGE_METADATA_XMP: metadata.xmp,
        cv2.IMAGE_METADATA_ICCP: metadata.icc,
    }
    return imencode(".avif", codes, options, blocks)


class _Block(Image.Exif):
    """An EXIF block that Pillow copies byte for byte, instead of making a new one."""

    def __init__(self, block: bytes) -> None:
        super().__init__()
        self.block = block

    def __contains__(self, tag: object) -> bool:
        """Deny all tags, so that Pillow removes none."""
        return False

    def __bool__(self) -> bool:
        """Return that there is a block."""
        return True

    def tobytes(self, offset: int = 8) -> bytes:  # noqa: ARG002 - Pillow's own signature
        """Return the block."""
        return self.block


def _pixels(data: bytes, picture: AvifImageFile, bits: int) -> Codes:
    """Decode to (H, W, C); OpenCV cannot decode grey with alpha, so Pillow does."""
    try:
        return np.atleast_3d(imdecode(data))
    except PhotoError:
        if bits > 8:
            raise
        return np.atleast_3d(np.asarray(picture))


def _exif(items: list[Item]) -> bytes:
    """Return the bytes of the EXIF block as stored: Pillow may return a new block."""
    for item in items:
        if item.kind == b"Exif":
            block = item.content[4:]  # first the length of what precedes the TIFF header
            return block[int.from_bytes(item.content[:4], "big") :]
    return b""


def _without(data: bytes, items: list[Item]) -> bytes:
    """Hide the metadata: if they lie behind the picture, OpenCV takes the file for damaged."""
    hidden = bytearray(data)
    for item in items:
        hidden[item.at : item.at + 4] = b"skip"
    return bytes(hidden)


def _configuration(properties: list[tuple[bytes, bytes]]) -> tuple[int, bool, int]:
    """Return bits a sample, whether it is grey, and the subsampling of the first picture."""
    for name, content in properties:
        if name == b"av1C" and len(content) > 2:
            flags = content[2]
            bits = 8 if not flags & 0x40 else 12 if flags & 0x20 else 10
            return bits, bool(flags & 0x10), (flags >> 3 & 1) + (flags >> 2 & 1)
    raise PhotoError("the AVIF is damaged", hint=DAMAGED)


def _profile_by_numbers(properties: list[tuple[bytes, bytes]]) -> bytes:
    """Make the profile for the code numbers of the colours; empty for sRGB."""
    for name, content in properties:
        if name == b"colr" and content[:4] == b"nclx" and len(content) >= 8:
            return cicp_profile(*struct.unpack_from(">HH", content, 4))
    return b""
