"""WebP in and out, lossy or lossless as the photo was."""

from __future__ import annotations

import io
from typing import Final

import numpy as np
from PIL import Image
from PIL.WebPImagePlugin import WebPImageFile

from deshake.errors import PhotoError
from deshake.formats.encoding import Decoded, Encoding, check_size, decoding
from deshake.metadata.metadata import Metadata

__all__ = ["decode_webp", "encode_webp"]

_QUALITY: Final = 95  # a lossy WebP does not state its own


def decode_webp(data: bytes) -> Decoded:
    """Decode a still WebP.

    Raises
    ------
    PhotoError
        If the file is damaged or cut short, too large, or animated.

    """
    with decoding("WebP"):
        _check_length(data)
        picture = WebPImageFile(io.BytesIO(data))
        check_size(picture.height, picture.width, len(data))
        if picture.n_frames > 1:
            raise PhotoError("an animated WebP", hint="take one still picture out of it")
        pixels = np.asarray(picture)
        metadata = Metadata(
            exif=picture.info.get("exif", b"").removeprefix(b"Exif\0\0"),
            xmp=picture.info.get("xmp", b""),
            icc=picture.info.get("icc_profile", b""),
        )
    alpha = np.ascontiguousarray(pixels[..., 3]) if picture.mode == "RGBA" else None
    encoding = Encoding("WEBP", lossless=_is_lossless(data))
    return Decoded(np.ascontiguousarray(pixels[..., :3]), alpha, encoding, metadata)


def encode_webp(picture: Decoded) -> bytes:
    """Encode 8-bit codes as WebP. Alpha, and the colours of transparent pixels, are kept.

    Raises
    ------
    PhotoError
        If a side is longer than WebP can hold.

    """
    if max(picture.codes.shape[:2]) > 16383:
        raise PhotoError("a WebP has at most 16383 pixels a side", hint="write a PNG or TIFF")
    codes = picture.codes if picture.codes.ndim == 3 else np.dstack([picture.codes] * 3)
    if picture.alpha is not None:
        codes = np.dstack([codes, picture.alpha])
    stream = io.BytesIO()
    Image.fromarray(codes).save(
        stream,
        "WEBP",
        lossless=picture.encoding.lossless,
        quality=_QUALITY,
        exact=True,
        exif=picture.metadata.exif,
        xmp=picture.metadata.xmp,
        icc_profile=picture.metadata.icc,
    )
    return stream.getvalue()


def _check_length(data: bytes) -> None:
    """Refuse a file that is shorter than its header states."""
    if len(data) < 12 or int.from_bytes(data[4:8], "little") + 8 > len(data):
        msg = "the file is shorter than it says"
        raise ValueError(msg)


def _is_lossless(data: bytes) -> bool:
    """Return whether the picture's chunk is of the lossless kind."""
    at = 12
    while at + 8 <= len(data):
        name, size = data[at : at + 4], int.from_bytes(data[at + 4 : at + 8], "little")
        if name in {b"VP8L", b"VP8 "}:
            return name == b"VP8L"
        at += 8 + size + size % 2
    return False
