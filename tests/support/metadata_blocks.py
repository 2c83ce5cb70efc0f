"""Fixtures that make EXIF blocks, ICC profiles and photos by other means than deshake's own."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

XMP = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><a tiff:Orientation="6" b="\xc3\xa9"/></x:xmpmeta>'


def _exif(order: str = "<", **tags: Any) -> bytes:
    """Make an EXIF block with Pillow: orientation, camera, exposure, GPS, a maker note."""
    exif = Image.Exif()
    exif.endian = order
    exif[0x010F] = tags.get("make", "Canon")
    exif[0x0110] = tags.get("model", "Canon DIGITAL IXUS 70")
    exif[0x0112] = tags.get("orientation", 1)
    below = {0x829A: 0.5, 0x920A: 5.8, 0x927C: b"maker\0note\1\2\3", 0x9286: b"ASCII\0\0\0hello"}
    exif._ifds[0x8769] = below | tags.get("below", {})
    exif._ifds[0x8825] = {1: "N", 2: (48.0, 51.0, 30.0)}
    return exif.tobytes().removeprefix(b"Exif\0\0")


def _icc(curve: bytes, *, blue: bytes | None = None, grey: bool = False) -> bytes:
    """Make the part of an ICC profile that matters here: header, tag table, curves."""
    names = [b"kTRC"] if grey else [b"rTRC", b"gTRC", b"bTRC"]
    datas = [curve, curve, blue or curve][: len(names)]
    table, body = b"", b""
    start = 128 + 4 + 12 * len(names)
    for name, data in zip(names, datas, strict=True):
        table += struct.pack(">4sII", name, start + len(body), len(data))
        body += data
    head = struct.pack(">I", start + len(body)).ljust(16, b"\0")
    head = (head + (b"GRAY" if grey else b"RGB ")).ljust(36, b"\0") + b"acsp"
    return head.ljust(128, b"\0") + struct.pack(">I", len(names)) + table + body


def _codes(
    height: int, width: int, channels: int = 1, depth: int = 8
) -> NDArray[np.unsignedinteger]:
    """Make codes that hold all values a small picture can, black and white among them."""
    kind = np.uint8 if depth == 8 else np.uint16
    top = np.iinfo(kind).max
    codes = np.random.default_rng(7).integers(0, top + 1, (height, width, channels)).astype(kind)
    codes.reshape(-1)[:2] = 0, top
    return codes[..., 0] if channels == 1 else codes


@pytest.fixture
def make_exif() -> Callable[..., bytes]:
    return _exif


@pytest.fixture
def make_icc() -> Callable[..., bytes]:
    return _icc


@pytest.fixture
def make_codes() -> Callable[..., NDArray[np.unsignedinteger]]:
    return _codes


@pytest.fixture
def xmp() -> bytes:
    return XMP


@pytest.fixture
def save(tmp_path: Path) -> Callable[..., Path]:
    """Save codes by Pillow under a name."""

    def write(name: str, codes: NDArray[Any] | Image.Image, **options: object) -> Path:
        path = tmp_path / name
        picture = codes if isinstance(codes, Image.Image) else Image.fromarray(codes)
        stream = io.BytesIO()
        form = {".jpg": "JPEG", ".tif": "TIFF", ".jp2": "JPEG2000"}.get(
            path.suffix, path.suffix[1:].upper()
        )
        picture.save(stream, form, **options)
        path.write_bytes(stream.getvalue())
        return path

    return write
