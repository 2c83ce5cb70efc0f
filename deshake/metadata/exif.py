"""The raw structure of EXIF and TIFF: directories of tags, read and appended.

Values are copied as the bytes that the camera wrote; no tag is decoded and encoded again. Here an
EXIF block is a small TIFF file, without the ``Exif`` marker of JPEG.

References
----------
.. [1] TIFF Revision 6.0, Adobe, 1992.
.. [2] CIPA DC-008, Exchangeable image file format for digital still cameras: Exif 2.32, 2019.

"""

from __future__ import annotations

import contextlib
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = [
    "LONGEST",
    "Directory",
    "Tree",
    "append_tree",
    "new_block",
    "orientation",
    "pointer",
    "read_below",
    "read_directory",
    "read_first",
    "read_tree",
]

LONGEST: Final = 65527
"""Bytes of the longest EXIF block that a JPEG can hold."""

ORIENTATION: Final = 274
SOFTWARE: Final = 305
EXIF_POINTER: Final = 34665
GPS_POINTER: Final = 34853
INTEROP_POINTER: Final = 40965
MAKER_NOTE: Final = 37500
XMP: Final = 700
IPTC: Final = 33723
IMAGE_RESOURCES: Final = 34377
ICC: Final = 34675

# Bytes of one value, by TIFF type; 16 to 18 are BigTIFF's, and no EXIF block holds them.
SIZES: Final = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4,
                129: 1}  # fmt: skip

# The codes of the struct module for types that are numbers; a fraction is two numbers.
NUMBERS: Final = {1: "B", 3: "H", 4: "I", 5: "II", 6: "b", 8: "h", 9: "i", 10: "ii", 11: "f",
                  12: "d", 13: "I"}  # fmt: skip

# Tags that describe the layout of this file, or point into it: never copied to another file.
_STRUCTURE: Final = frozenset(
    {254, 255, 256, 257, 258, 259, 262, 263, 264, 265, 266, 273, 277, 278, 279, 280, 281, 284,
     288, 289, 290, 291, 292, 293, 301, 317, 320, 321, 322, 323, 324, 325, 330, 332, 333, 334,
     336, 337, 338, 339, 340, 341, 342, 347, 400, 512, 513, 514, 515, 517, 518, 519, 520, 521, 529,
     530, 531, 532, XMP, IPTC, IMAGE_RESOURCES, ICC, EXIF_POINTER, GPS_POINTER, INTEROP_POINTER,
     37724}
)  # fmt: skip

Values = dict[int, tuple[int, int, bytes]]  # tag: type, count, the value's bytes


@dataclass(frozen=True)
class Directory:
    """One directory (IFD) of an EXIF block or TIFF file.

    Parameters
    ----------
    order : str
        Byte order of the file, "<" or ">".
    values : dict
        Type, count and raw bytes by tag.
    places : dict
        Where each tag's value begins in the block.
    start : int
        Where it begins in the block.
    whole : bool
        Whether all its entries could be read.
    next_at : int
        Where the offset of the next directory is stored.

    """

    order: str
    values: Values
    places: dict[int, int]
    start: int
    whole: bool
    next_at: int

    def numbers(self, tag: int) -> list[float]:
        """Return a tag's numbers; fractions over 0 become nan, other types an empty list."""
        kind, count, raw = self.values.get(tag, (0, 0, b""))
        code = NUMBERS.get(kind)
        if code is None:
            return []
        parts = struct.unpack(f"{self.order}{len(code) * count}{code[0]}", raw)
        if len(code) == 1:
            return [float(x) for x in parts]
        return [
            top / bottom if bottom else float("nan")
            for top, bottom in zip(parts[::2], parts[1::2], strict=True)
        ]

    def text(self, tag: int) -> str:
        """Return a tag's text up to its first NUL, without surrounding blanks."""
        kind, _, raw = self.values.get(tag, (0, 0, b""))
        if kind not in {2, 7, 129}:
            return ""
        return raw.split(b"\0", 1)[0].decode("utf-8", "replace").strip()


@dataclass
class Tree:
    """The directories that carry metadata: the main one, EXIF, GPS and interoperability."""

    order: str = "<"
    main: Values = field(default_factory=dict)
    exif: Values = field(default_factory=dict)
    gps: Values = field(default_factory=dict)
    interop: Values = field(default_factory=dict)

    def __bool__(self) -> bool:
        """Return whether there is any metadata."""
        return bool(self.main or self.exif or self.gps)


def read_first(block: bytes) -> Directory | None:
    """Read the first directory of an EXIF block or TIFF file; None if there is none."""
    order = {b"II": "<", b"MM": ">"}.get(block[:2])
    if order is None:
        return None
    try:
        (version,) = struct.unpack_from(f"{order}H", block, 2)
        big = version == 43
        (offset,) = struct.unpack_from(f"{order}{'Q' if big else 'I'}", block, 8 if big else 4)
        return read_directory(block, order, offset, big=big)
    except struct.error:
        return None


def read_below(block: bytes, parent: Directory, pointer: int) -> Directory | None:
    """Read the directory that a pointer tag of its parent leads to; None if there is none."""
    offset = parent.numbers(pointer)
    if not offset:
        return None
    big = struct.unpack_from(f"{parent.order}H", block, 2)[0] == 43
    try:
        return read_directory(block, parent.order, int(offset[0]), big=big)
    except struct.error:
        return None


def read_sub_directories(block: bytes, parent: Directory, pointer: int) -> list[Directory]:
    """Read all directories that a pointer tag leads to, except damaged ones."""
    directories = []
    for offset in parent.numbers(pointer):
        with contextlib.suppress(struct.error, OverflowError):
            directories.append(read_directory(block, parent.order, int(offset), big=False))
    return directories


def read_tree(block: bytes) -> Tree:
    """Collect the metadata of an EXIF block or a TIFF file, without tags of its pixels."""
    first = read_first(block)
    if first is None:
        return Tree()
    tree = Tree(first.order, {t: v for t, v in first.values.items() if t not in _STRUCTURE})
    if (gps := read_below(block, first, GPS_POINTER)) is not None:
        tree.gps = gps.values
    if (exif := read_below(block, first, EXIF_POINTER)) is not None:
        tree.exif = {t: v for t, v in exif.values.items() if t not in _STRUCTURE}
        if (interop := read_below(block, exif, INTEROP_POINTER)) is not None:
            tree.interop = interop.values
    return tree


def append_tree(data: bytes, tree: Tree, *, note_at: int | None = None) -> bytes:
    """Append directories to a TIFF file and make its header point at the new main one.

    No byte of `data` moves, so that offsets in the main directory stay valid.

    Parameters
    ----------
    data : bytes
        A TIFF file, or its bare header, in the byte order of `tree`.
    tree : Tree
        The directories; this function makes the pointers between them.
    note_at : int, optional
        Where the maker note lies in `data`, if it is there.

    """
    out = bytearray(data)
    exif = dict(tree.exif)
    if tree.interop:
        exif[INTEROP_POINTER] = pointer(tree.order, _append(out, tree.order, tree.interop))
    main = dict(tree.main)
    if exif:
        placed = {} if note_at is None else {MAKER_NOTE: note_at}
        main[EXIF_POINTER] = pointer(tree.order, _append(out, tree.order, exif, placed))
    if tree.gps:
        main[GPS_POINTER] = pointer(tree.order, _append(out, tree.order, tree.gps))
    struct.pack_into(f"{tree.order}I", out, 4, _append(out, tree.order, main))
    return bytes(out)


def new_block(tree: Tree, *, note_at: int | None = None) -> bytes:
    """Make an EXIF block of directories; empty if all directories are.

    Parameters
    ----------
    tree : Tree
        The directories.
    note_at : int, optional
        Where the maker note should lie: its offsets often count from the beginning of the block.
        It lies there if the block then fits into a JPEG.

    """
    mark = (b"II*\0" if tree.order == "<" else b"MM\0*") + bytes(4)
    if not tree:
        return b""
    note = tree.exif.get(MAKER_NOTE, (0, 0, b""))[2]
    if note_at is not None and len(note) > 4 and len(mark) <= note_at <= LONGEST:
        block = append_tree(mark.ljust(note_at, b"\0") + note, tree, note_at=note_at)
        if len(block) <= LONGEST:
            return block
    return append_tree(mark, tree)


def orientation(block: bytes) -> int:
    """Return the orientation, 1 to 8, that an EXIF block or TIFF file states; 1 if none."""
    first = read_first(block)
    stated = [] if first is None else first.numbers(ORIENTATION)
    return int(stated[0]) if len(stated) == 1 and stated[0] in range(1, 9) else 1


def read_directory(block: bytes, order: str, offset: int, *, big: bool) -> Directory:
    """Read one directory, without entries of unknown type or with values outside the block.

    The values of a directory together may not be longer than the block. So a few entries cannot
    copy the same bytes again and again.
    """
    count_code, entry_code, width, inline = ("Q", "HHQ", 20, 8) if big else ("H", "HHI", 12, 4)
    (count,) = struct.unpack_from(f"{order}{count_code}", block, offset)
    start = offset + struct.calcsize(f"<{count_code}")
    values: Values = {}
    places: dict[int, int] = {}
    left = len(block)
    for entry in range(start, min(start + count * width, len(block) - width + 1), width):
        tag, kind, number = struct.unpack_from(f"{order}{entry_code}", block, entry)
        size = SIZES.get(kind, 0) * number
        place = entry + width - inline
        if size > inline:
            (place,) = struct.unpack_from(f"{order}{'Q' if big else 'I'}", block, place)
        if 0 < size <= left and place + size <= len(block):
            values[tag] = (kind, number, block[place : place + size])
            places[tag] = place
            left -= size
    whole = len(values) == count
    return Directory(order, values, places, offset, whole, start + count * width)


def pointer(order: str, offset: int) -> tuple[int, int, bytes]:
    """Return the value of a tag that points at a directory."""
    return 4, 1, struct.pack(f"{order}I", offset)


def _append(
    out: bytearray, order: str, values: Values, placed: Mapping[int, int] | None = None
) -> int:
    """Append one directory, then its values that are not in `out` yet; return its offset."""
    if len(out) % 2:
        out += b"\0"
    offset = len(out)
    behind = offset + 2 + 12 * len(values) + 4
    entries, data = bytearray(), bytearray()
    for tag in sorted(values):
        kind, count, raw = values[tag]
        entries += struct.pack(f"{order}HHI", tag, kind, count)
        if placed and tag in placed:
            entries += struct.pack(f"{order}I", placed[tag])
        elif len(raw) <= 4:
            entries += raw.ljust(4, b"\0")
        else:
            entries += struct.pack(f"{order}I", behind + len(data))
            data += raw + b"\0" * (len(raw) % 2)
    out += struct.pack(f"{order}H", len(values)) + entries + bytes(4) + data
    return offset
