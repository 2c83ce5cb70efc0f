"""The compressed picture of a JPEG, which is copied if no pixel has changed.

Encoding a decoded JPEG again changes its values, above all where the colours have half the
resolution. Only the same bytes give the same values.
"""

from __future__ import annotations

import re
import struct
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray

__all__ = ["Frame", "frame_of", "with_frame"]

_SOI: Final = b"\xff\xd8"
_JFIF: Final = b"\xff\xe0", b"JFIF\0"
_ADOBE: Final = b"\xff\xee", b"Adobe"
_COMMENT: Final = 0xFE
_SCAN, _END = 0xDA, 0xD9
_MARKER: Final = re.compile(rb"\xff+([\x01-\xcf\xd8-\xfe])")
"""A marker in compressed data: neither a stuffed byte nor a restart marker."""


class Frame(NamedTuple):
    """The compressed picture of a JPEG, and the pixels that were read from it."""

    data: bytes
    pixels: NDArray[np.float32]

    def of(self, pixels: NDArray[np.float32]) -> bytes:
        """Return the data if the pixels are this same array; else nothing."""
        return self.data if pixels is self.pixels else b""


class _Segment(NamedTuple):
    """A segment of a JPEG: its marker's number, where it ends, and all its bytes."""

    number: int
    end: int
    data: bytes


def frame_of(data: bytes) -> bytes:
    """Return the first picture of a JPEG: tables and scans, without metadata.

    Empty if the picture has no end. The JFIF header is kept, and Adobe's, which names the colour
    transform.
    """
    kept = [segment.data for segment in _header(data) if not _is_metadata(segment)]
    at = next((segment.end for segment in _header(data) if segment.number == _SCAN), 0)
    if not at:
        return b""
    start = at
    while marker_match := _MARKER.search(data, at):
        if marker_match[1][0] == _END:
            return b"".join(kept) + data[start : marker_match.end()]
        at = marker_match.end() + _length(data, marker_match.end())
    return b""


def with_frame(header: bytes, frame: bytes) -> bytes:
    """Return the metadata of one JPEG with the picture that `frame_of` took from another."""
    metadata = b"".join(segment.data for segment in _header(header) if _is_metadata(segment))
    first = next(_segments(frame, 0))
    cut = first.end if _starts(first, _JFIF) else 0  # JFIF comes first of all
    return _SOI + frame[:cut] + metadata + frame[cut:]


def _header(data: bytes) -> Iterator[_Segment]:
    """Yield the segments up to the first scan, its header included."""
    for segment in _segments(data, len(_SOI)):
        yield segment
        if segment.number == _SCAN:
            return


def _segments(data: bytes, at: int) -> Iterator[_Segment]:
    """Yield the segments from a place on, up to the first byte that does not begin one."""
    while marker_match := _MARKER.match(data, at):
        start, at = at, marker_match.end() + _length(data, marker_match.end())
        yield _Segment(marker_match[1][0], at, b"\xff" + data[marker_match.end() - 1 : at])
        if at <= start:
            return


def _length(data: bytes, at: int) -> int:
    """Return the length that a segment states; if it is cut off, the length of all data."""
    if at + 2 > len(data):
        return len(data)
    length: int = struct.unpack_from(">H", data, at)[0]
    return length


def _is_metadata(segment: _Segment) -> bool:
    """Return whether the decoder of the picture does not need a segment."""
    application = 0xE0 <= segment.number <= 0xEF
    needed = _starts(segment, _JFIF) or _starts(segment, _ADOBE)
    return segment.number == _COMMENT or (application and not needed)


def _starts(segment: _Segment, mark: tuple[bytes, bytes]) -> bool:
    marker, name = mark
    return segment.data.startswith(marker) and segment.data[4:].startswith(name)
