"""Changes to an EXIF block that move no other byte.

Maker notes hold offsets that count from the beginning of the block, and not all of these are
documented. So bytes are overwritten or appended, never moved.
"""

from __future__ import annotations

import contextlib
import math
import struct
from typing import Final

from deshake.metadata import exif
from deshake.metadata.density import Density

__all__ = [
    "complete",
    "maker_note_at",
    "pointers",
    "scaled",
    "shortened",
    "upright",
    "with_size",
    "with_software",
    "without_thumbnail",
]

_SIZES_BELOW: Final = (0xA002, 0xA003)  # PixelXDimension, PixelYDimension
_SIZES: Final = (256, 257)  # ImageWidth, ImageLength
_FOCAL_PLANE: Final = (0xA20E, 0xA20F)  # FocalPlaneXResolution, FocalPlaneYResolution
_SUBJECTS: Final = (0x9214, 0xA214)  # SubjectArea, SubjectLocation
_FINE: Final = 1000  # the denominator of changed fractions
_THUMBNAIL: Final = (513, 514)  # JPEGInterchangeFormat, and its length


def maker_note_at(block: bytes) -> int | None:
    """Return where the maker note of an EXIF block or TIFF file begins; None if there is none."""
    first = exif.read_first(block)
    below = None if first is None else exif.read_below(block, first, exif.EXIF_POINTER)
    return None if below is None else below.places.get(exif.MAKER_NOTE)


def upright(block: bytes) -> bytes:
    """Return an EXIF block with orientation 1, for pixels that are upright now."""
    first = exif.read_first(block)
    if first is None or exif.orientation(block) == 1:
        return block
    out = bytearray(block)
    _set(out, first, exif.ORIENTATION, 1)
    return bytes(out)


def complete(block: bytes, density: Density | None, size: tuple[int, int], *, icc: bool) -> bytes:
    """Return an EXIF block with the tags that the standard requires in every JPEG.

    Only a block that holds nothing but Software, as `with_software` makes it, is completed. A
    camera's block is returned unchanged.

    Parameters
    ----------
    block : bytes
        The block.
    density : Density or None
        Density of the photo; None: 72 pixels an inch, the standard's default.
    size : (int, int)
        Height and width of the picture.
    icc : bool
        Whether a profile defines the colours; else they are sRGB's.

    """
    first = exif.read_first(block)
    if first is None or set(first.values) != {exif.SOFTWARE}:
        return block
    order, (height, width) = first.order, size
    stated = density or Density(72, 72)
    main = first.values | stated.tags(order) | {531: (3, 1, struct.pack(f"{order}H", 1))}
    below: exif.Values = {
        0x9000: (7, 4, b"0232"),  # ExifVersion
        0x9101: (7, 4, b"\1\2\3\0"),  # ComponentsConfiguration
        0xA000: (7, 4, b"0100"),  # FlashpixVersion
        0xA001: (3, 1, struct.pack(f"{order}H", 0xFFFF if icc else 1)),  # ColorSpace
    }
    for tag, side in zip(_SIZES_BELOW, (width, height), strict=True):
        below[tag] = 4, 1, struct.pack(f"{order}I", side)
    return exif.new_block(exif.Tree(order, main, below))


def with_size(block: bytes, height: int, width: int) -> bytes:
    """Return an EXIF block with this size of the picture, wherever it states one."""
    first = exif.read_first(block)
    if first is None:
        return block
    out = bytearray(block)
    below = exif.read_below(block, first, exif.EXIF_POINTER)
    for directory, tags in ((first, _SIZES), (below, _SIZES_BELOW)):
        if directory is not None:
            for tag, size in zip(tags, (width, height), strict=True):
                _set(out, directory, tag, size)
    return bytes(out)


def scaled(block: bytes, across: float, down: float) -> bytes:
    """Return an EXIF block for a picture that was reduced by two factors.

    The resolution of the focal plane and the place of the subject are in pixels of the picture, and
    become smaller. `with_size` changes the size.
    """
    first = exif.read_first(block)
    below = None if first is None else exif.read_below(block, first, exif.EXIF_POINTER)
    if below is None:
        return block
    out = bytearray(block)
    for tag, factor in zip(_FOCAL_PLANE, (across, down), strict=True):
        _multiply(out, below, tag, (factor,))
    for tag in _SUBJECTS:
        _multiply(out, below, tag, (across, down))
    return bytes(out)


def without_thumbnail(block: bytes) -> bytes:
    """Return an EXIF block without its thumbnail, which shows the photo before the work.

    The four bytes that point at its directory become zero. The thumbnail becomes zero too; if it is
    the end of the block, it is cut off.
    """
    first = exif.read_first(block)
    if first is None or not any(block[first.next_at : first.next_at + 4]):
        return block
    out = bytearray(block)
    out[first.next_at : first.next_at + 4] = bytes(len(out[first.next_at : first.next_at + 4]))
    try:
        (start,) = struct.unpack_from(f"{first.order}I", block, first.next_at)
        second = exif.read_directory(block, first.order, start, big=False)
    except struct.error:
        second = None
    place, size = (
        int(number[0]) if second is not None and (number := second.numbers(tag)) else 0
        for tag in _THUMBNAIL
    )
    end = place + size
    if place >= 8 and end <= len(out) and not _is_used(block, place, end):
        out[place:end] = b"" if end == len(out) else bytes(size)
    return bytes(out)


def shortened(block: bytes, longest: int) -> tuple[bytes, list[int]]:
    """Make a new EXIF block no longer than `longest`, if need be without the longest values.

    Returns
    -------
    block : bytes
        The block.
    dropped : list of int
        Tags that were dropped, those of the longest values first.

    """
    tree, place = exif.read_tree(block), maker_note_at(block)
    dropped: list[int] = []
    while len(shorter := exif.new_block(tree, note_at=place)) > longest:
        directories = (tree.main, tree.exif, tree.gps, tree.interop)
        values = max(directories, key=lambda d: max((len(v[2]) for v in d.values()), default=0))
        tag = max(values, key=lambda tag: len(values[tag][2]))
        dropped.append(tag)
        del values[tag]
    return shorter, dropped


def with_software(block: bytes, software: str) -> bytes:
    """Return an EXIF block with another Software tag; a new block if there is none.

    A new first directory is appended to the block. A block that is damaged, or that would become
    too long for a JPEG, is returned unchanged.
    """
    raw = software.encode() + b"\0"
    if not block:
        return exif.new_block(exif.Tree(main={exif.SOFTWARE: (2, len(raw), raw)}))
    first = exif.read_first(block)
    if first is None or block[2:4] not in {b"*\0", b"\0*"}:
        return block
    order = first.order
    (start,) = struct.unpack_from(f"{order}I", block, 4)
    entries = dict[int, bytes]()
    for at in range(start + 2, min(first.next_at, len(block) - 11), 12):
        (tag,) = struct.unpack_from(f"{order}H", block, at)
        entries.setdefault(tag, block[at : at + 12])
    out = bytearray(block)
    out += bytes(len(out) % 2)
    entries[exif.SOFTWARE] = struct.pack(f"{order}HHII", exif.SOFTWARE, 2, len(raw), len(out))
    out += raw + bytes(len(raw) % 2)
    struct.pack_into(f"{order}I", out, 4, len(out))
    out += struct.pack(f"{order}H", len(entries)) + b"".join(
        entries[tag] for tag in sorted(entries)
    )
    out += block[first.next_at : first.next_at + 4].ljust(4, b"\0")
    return block if len(out) > exif.LONGEST >= len(block) else bytes(out)


def pointers(block: bytes) -> exif.Values | None:
    """Return the tags that lead from a block's first directory to the others, for another file.

    The block must be the beginning of that file. None if there are no other directories, or if some
    of their entries are unreadable: then new directories are better.
    """
    first = exif.read_first(block)
    if first is None or block[2:4] not in {b"*\0", b"\0*"}:
        return None
    links: exif.Values = {}
    below = [(first, exif.EXIF_POINTER), (first, exif.GPS_POINTER)]
    for parent, tag in below:
        directory = exif.read_below(block, parent, tag)
        if directory is not None:
            if not directory.whole:
                return None
            if parent is first:
                links[tag] = exif.pointer(first.order, directory.start)
            if tag == exif.EXIF_POINTER:
                below.append((directory, exif.INTEROP_POINTER))
    return links or None


def _set(out: bytearray, directory: exif.Directory, tag: int, number: int) -> None:
    """Overwrite a tag that is one number, of any type, if the type can hold the new one."""
    kind, count, _ = directory.values.get(tag, (0, 0, b""))
    if count != 1 or kind not in exif.NUMBERS:
        return
    code = exif.NUMBERS[kind]
    with contextlib.suppress(struct.error):  # too large for the type
        raw = struct.pack(f"{directory.order}{code}", number, *[1] * (len(code) - 1))
        place = directory.places[tag]
        out[place : place + len(raw)] = raw


def _multiply(
    out: bytearray, directory: exif.Directory, tag: int, factors: tuple[float, ...]
) -> None:
    """Multiply the numbers of a tag by the factors in turn, if none of them is negative."""
    numbers = directory.numbers(tag)
    kind = directory.values.get(tag, (0, 0, b""))[0]
    if not numbers or not all(0 <= number < math.inf for number in numbers):
        return
    code = exif.NUMBERS[kind]
    parts: list[float] = []
    for at, number in enumerate(numbers):
        product = number * factors[at % len(factors)]
        if len(code) == 2:
            parts += [round(_FINE * product), _FINE]
        else:
            parts.append(product if code in "fd" else round(product))
    with contextlib.suppress(struct.error):  # too large for the type
        raw = struct.pack(f"{directory.order}{len(parts)}{code[0]}", *parts)
        place = directory.places[tag]
        out[place : place + len(raw)] = raw


def _is_used(block: bytes, start: int, end: int) -> bool:
    """Return whether a directory, or one of its values, overlaps a range of the block."""
    first = exif.read_first(block)
    directories = [first] if first is not None else []
    for parent in directories:
        for link in (exif.EXIF_POINTER, exif.GPS_POINTER, exif.INTEROP_POINTER):
            below = exif.read_below(block, parent, link)
            if below is not None and len(directories) < 4:
                directories.append(below)
    used = [(d.start, d.next_at + 4) for d in directories]
    used += [
        (d.places[t], d.places[t] + len(d.values[t][2])) for d in directories for t in d.values
    ]
    return any(low < end and start < high for low, high in used)
