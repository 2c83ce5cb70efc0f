"""Files of nested boxes (ISO base media): HEIC, AVIF, JPEG 2000 and Canon's CR3.

References
----------
.. [1] ISO/IEC 14496-12, ISO base media file format, Sec. 4.2.
.. [2] ISO/IEC 15444-1, JPEG 2000, Annex I.

"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final, NamedTuple

from deshake.metadata import exif

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["Item", "canon_exif", "item_properties", "metadata_items", "read_boxes"]

_CANON: Final = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
_MAX_BOXES: Final = 4096  # boxes, or items, of one list; further ones are ignored


class Item(NamedTuple):
    """A block of metadata in a file of boxes: its type, the place of the type, its content."""

    kind: bytes
    at: int
    content: bytes


def read_boxes(
    data: bytes, start: int = 0, end: int | None = None
) -> Iterator[tuple[bytes, int, int]]:
    """Walk over the boxes of a file, or of a box.

    Yields
    ------
    bytes, int, int
        The type, and where the content begins and ends. A damaged box ends the walk.

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
    for name, start, end in _in_meta(data):
        if name == b"iprp":
            for box, first, last in read_boxes(data, start, end):
                if box == b"ipco":
                    return [(kind, data[a:b]) for kind, a, b in read_boxes(data, first, last)]
    return []


def metadata_items(data: bytes) -> list[Item]:
    """Return the blocks of metadata, EXIF and XMP, in a HEIC or AVIF file."""
    boxes = {name: (start, end) for name, start, end in _in_meta(data)}
    if b"iinf" not in boxes or b"iloc" not in boxes:
        return []
    try:
        extents = dict(_extents(data[slice(*boxes[b"iloc"])]))
        start, end = boxes[b"iinf"]
        items = []
        for name, at, _ in read_boxes(data, start + (6 if data[start] == 0 else 8), end):
            wide = 2 if data[at] == 3 else 0  # the item's number has 2 bytes more
            (number,) = struct.unpack_from(">I" if wide else ">H", data, at + 4)
            kind = data[at + 8 + wide : at + 12 + wide]
            if name == b"infe" and kind in {b"Exif", b"mime"} and number in extents:
                content = b"".join(data[a : a + size] for a, size in extents[number])
                items.append(Item(kind, at + 8 + wide, content))
    except (struct.error, IndexError):
        return []
    return items


def _in_meta(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Walk over the boxes in the box that describes all items."""
    for name, start, end in read_boxes(data):
        if name == b"meta":
            yield from read_boxes(data, start + 4, end)  # behind version and flags
            return


def _extents(box: bytes) -> Iterator[tuple[int, list[tuple[int, int]]]]:
    """Read where items lie: their numbers, and the offsets and lengths of their parts [1]_."""
    version, sizes = box[0], (box[4] >> 4, box[4] & 15, box[5] >> 4, box[5] & 15)
    at = 6

    def number(size: int) -> int:
        nonlocal at
        if at + size > len(box):
            raise struct.error
        at += size
        return int.from_bytes(box[at - size : at], "big")

    wide = 4 if version == 2 else 2
    for _ in range(min(number(wide), _MAX_BOXES)):
        item = number(wide)
        method = number(2) & 15 if version else 0
        number(2)  # the number of the file that holds it: this file
        base = number(sizes[2])
        parts = []
        for _ in range(number(2)):
            if version:
                number(sizes[3])
            offset = number(sizes[0])
            parts.append((base + offset, number(sizes[1])))
        if method == 0:  # offsets count from the file's beginning
            yield item, parts


def canon_exif(data: bytes) -> exif.Tree:
    """Read the EXIF of a CR3, which has separate blocks for the main tags, EXIF and GPS."""
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
