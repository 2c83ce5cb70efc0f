"""Photoshop's image resources, which hold the IPTC of JPEGs and TIFFs, and thumbnails.

References
----------
.. [1] Adobe Photoshop File Formats Specification, November 2019.

"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["iptc_of", "with_iptc", "without_padding", "without_thumbnails"]

_IPTC: Final = 0x0404
_THUMBNAILS: Final = (0x0409, 0x040C)
_MARK: Final = b"8BIM"
_RECORD: Final = b"\x1c"


def iptc_of(resources: bytes) -> bytes:
    """Return the IPTC records among image resources; empty if there are none."""
    return next((content for kind, content, _ in _walk(resources) if kind == _IPTC), b"")


def with_iptc(resources: bytes, iptc: bytes) -> bytes:
    """Return image resources that hold these IPTC records, and no others."""
    if iptc_of(resources) == iptc:
        return resources
    kept = b"".join(whole for kind, _, whole in _walk(resources) if kind != _IPTC)
    head = _MARK + struct.pack(">HHI", _IPTC, 0, len(iptc))
    return head + iptc + bytes(len(iptc) % 2) + kept


def without_padding(iptc: bytes) -> bytes:
    """Return IPTC records without the zeros that fill their last word in a TIFF."""
    at = 0
    while iptc[at : at + 1] == _RECORD and len(iptc) >= at + 5:
        (size,) = struct.unpack_from(">H", iptc, at + 3)
        if size & 0x8000:  # an extended record: its size has another form
            return iptc
        at += 5 + size
    rest = iptc[at:]
    return iptc[:at] if len(rest) < 4 and not any(rest) else iptc


def without_thumbnails(resources: bytes) -> bytes:
    """Return image resources without the thumbnails that Photoshop puts there."""
    return b"".join(whole for kind, _, whole in _walk(resources) if kind not in _THUMBNAILS)


def _walk(resources: bytes) -> Iterator[tuple[int, bytes, bytes]]:
    """Walk over the resources: number, content, and all bytes; damaged bytes get number 0."""
    at = 0
    while at < len(resources):
        name_at = at + 6
        size_at = name_at + 1 + (resources[name_at] if name_at < len(resources) else 0)
        size_at += size_at % 2 ^ at % 2
        start = size_at + 4
        if start > len(resources) or resources[at : at + 4] != _MARK:
            yield 0, b"", resources[at:]
            return
        (kind,) = struct.unpack_from(">H", resources, at + 4)
        (size,) = struct.unpack_from(">I", resources, size_at)
        end = start + size
        if end > len(resources):
            yield 0, b"", resources[at:]
            return
        whole = min(end + size % 2, len(resources))
        yield kind, resources[start:end], resources[at:whole]
        at = whole
