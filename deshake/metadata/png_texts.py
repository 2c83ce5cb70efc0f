"""Metadata in the texts of a PNG, in ImageMagick's form: "Raw profile type exif" etc.

A PNG can hold IPTC in no other way. Older programs store EXIF and XMP like this, too.
"""

from __future__ import annotations

import re
from typing import Final

from deshake.metadata.image_resources import iptc_of

__all__ = ["RAW_PROFILE", "profile_text", "raw_profile"]

RAW_PROFILE: Final = b"Raw profile type "
"""The beginning of the keyword of such a text."""

_EXIF: Final = b"Exif\0\0"
_XMP: Final = b"http://ns.adobe.com/xap/1.0/\0"
_TEXT: Final = re.compile(rb"\s*\w{1,40}\s+(\d{1,10})\s([0-9a-fA-F\s]*)")


def raw_profile(keyword: bytes, text: bytes) -> dict[str, bytes]:
    """Read a profile; return the fields of `Metadata` that it fills, none if it is unknown.

    Parameters
    ----------
    keyword : bytes
        The keyword of the text; bytes from its NUL on are ignored.
    text : bytes
        A name, the length in bytes, and the bytes in hexadecimal.

    """
    kind = keyword.split(b"\0", 1)[0].removeprefix(RAW_PROFILE).lower()
    match = _TEXT.match(text)
    digits = b"" if match is None else b"".join(match[2].split())
    data = bytes.fromhex(digits[: len(digits) // 2 * 2].decode("ascii"))
    if match is None or len(data) != int(match[1]):
        return {}
    if kind in {b"exif", b"app1"} and data.startswith(_EXIF):
        return {"exif": data.removeprefix(_EXIF)}
    if kind in {b"xmp", b"app1"} and not data.startswith(_EXIF):
        return {"xmp": data.removeprefix(_XMP)}
    if kind in {b"icc", b"icm"}:
        return {"icc": data}
    if kind in {b"iptc", b"8bim"} and data.startswith(b"8BIM"):
        return {"iptc": iptc_of(data), "resources": data}
    return {"iptc": data} if kind == b"iptc" else {}


def profile_text(data: bytes) -> bytes:
    """Return the text that holds image resources with IPTC."""
    digits = data.hex()
    lines = "\n".join(digits[at : at + 72] for at in range(0, len(digits), 72))
    return f"\niptc\n{len(data):8}\n{lines}\n".encode("ascii")
