"""The compressed picture of a JPEG, to be carried as it is where no pixel has changed.

Encoding a decoded JPEG again moves its values, most of all where colours were kept at half the
size: the only way to give the same ones is to give the same bytes.
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
"""In compressed data: neither a stuffed byte nor a restart marker."""


class Frame(NamedTuple):
    """The compressed picture of a JPEG, and the pixels that were read from it."""

    data: bytes
    pixels: NDArray[np.float32]

    def of(self, pixels: NDArray[np.float32]) -> bytes:
        """Return the data, if these are the very pixels; else nothing."""
        return self.data if pixels is self.pixels else b""


class _Segment(NamedTuple):
    """A segment of a JPEG: its marker's number, where it ends, and all its bytes."""

    number: int
    end: int
    data: bytes


def frame_of(data: bytes) -> bytes:
    """Return the first picture of a JPEG: tables and scans, without metadata.

    Empty if there is no end to it. The JFIF header stays, and Adobe's, which names the colour
    transform.
    """
    kept = [segment.data for segment in _header(data) if not _is_metadata(segment)]
    at = next((segment.end for segment in _header(data) if segment.number == _SCAN), 0)
    if not at:
        return b""
    start = at
    while found := _MARKER.search(data, at):
        if found[1][0] == _END:
            return b"".join(kept) + data[start : found.end()]
        at = found.end() + _length(data, found.end())
    return b""


def with_frame(header: bytes, frame: bytes) -> bytes:
    """Return the metadata of one JPEG with the picture that `frame_of` took from another."""
    metadata = b"".join(segment.data for segment in _header(header) if _is_metadata(segment))
    first = next(_segments(frame, 0))
    cut = first.end if _starts(first, _JFIF) else 0  # it comes first of all
    return _SOI + frame[:cut] + metadata + frame[cut:]


def _header(data: bytes) -> Iterator[_Segment]:
    """Yield the segments up to the first scan, its header included."""
    for segment in _segments(data, len(_SOI)):
        yield segment
        if segment.number == _SCAN:
            return


def _segments(data: bytes, at: int) -> Iterator[_Segment]:
    """Yield the segments from a place on, until there is something else."""
    while found := _MARKER.match(data, at):
        start, at = at, found.end() + _length(data, found.end())
        yield _Segment(found[1][0], at, b"\xff" + data[found.end() - 1 : at])
        if at <= start:
            return


def _length(data: bytes, at: int) -> int:
    """Return the length that a segment gives of itself; more than there is if it does not."""
    if at + 2 > len(data):
        return len(data)
    length: int = struct.unpack_from(">H", data, at)[0]
    return length


def _is_metadata(segment: _Segment) -> bool:
    """Tell whether a segment says nothing about how the picture is decoded."""
    application = 0xE0 <= segment.number <= 0xEF
    needed = _starts(segment, _JFIF) or _starts(segment, _ADOBE)
    return segment.number == _COMMENT or (application and not needed)


def _starts(segment: _Segment, mark: tuple[bytes, bytes]) -> bool:
    marker, name = mark
    return segment.data.startswith(marker) and segment.data[4:].startswith(name)
