"""Files of nested boxes (ISO base media): HEIC, AVIF, JPEG 2000 and Canon's CR3.

References
----------
.. [1] ISO/IEC 14496-12, ISO base media file format, Sec. 4.2.
.. [2] ISO/IEC 15444-1, JPEG 2000, Annex I.

"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

from deshake.io import exif

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["canon_exif", "item_properties", "read_boxes"]

_CANON: Final = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
_MAX_BOXES: Final = 4096


def read_boxes(
    data: bytes, start: int = 0, end: int | None = None
) -> Iterator[tuple[bytes, int, int]]:
    """Walk over the boxes of a file, or of a box.

    Yields
    ------
    bytes, int, int
        The type, and where the content begins and ends. A box that is damaged ends the walk.

    """
    end = len(data) if end is None else end
    for _ in range(_MAX_BOXES):
        if start + 8 > end:
            return
        size, name = struct.unpack_from(">I4s", data, start)
        head = 8
        if size == 1 and start + 16 <= end:
            (size,) = struct.unpack_from(">Q", data, start + 8)
            head = 16
        elif size == 0:  # to the end
            size = end - start
        if size < head or start + size > end:
            return
        yield name, start + head, start + size
        start += size


def item_properties(data: bytes) -> list[tuple[bytes, bytes]]:
    """Return the properties of the pictures in a HEIC or AVIF file: types and contents."""
    found = []
    for name, start, end in read_boxes(data):
        if name != b"meta":
            continue
        for inner, first, last in read_boxes(data, start + 4, end):  # behind version and flags
            if inner != b"iprp":
                continue
            for box, a, b in read_boxes(data, first, last):
                if box == b"ipco":
                    found += [(kind, data[x:y]) for kind, x, y in read_boxes(data, a, b)]
    return found


def canon_exif(data: bytes) -> exif.Tree:
    """Read the EXIF of a CR3: blocks of its own for the main tags, EXIF and GPS."""
    blocks = {}
    for name, start, end in read_boxes(data):
        if name != b"moov":
            continue
        for inner, first, last in read_boxes(data, start, end):
            if inner == b"uuid" and data[first : first + 16] == _CANON:
                blocks = {
                    box: exif.read_first(data[a:b])
                    for box, a, b in read_boxes(data, first + 16, last)
                    if box in {b"CMT1", b"CMT2", b"CMT4"}
                }
    main, below, gps = (blocks.get(box) for box in (b"CMT1", b"CMT2", b"CMT4"))
    if main is None:
        return exif.Tree()
    tree = exif.Tree(main.order, main.values)
    if below is not None and below.order == main.order:
        tree.exif = below.values
    if gps is not None and gps.order == main.order:
        tree.gps = gps.values
    return tree
