"""Changes to an EXIF block that leave all else where it is.

Maker notes hold offsets that count from the beginning of the block, and nobody knows all of them:
bytes are overwritten or appended, never moved.
"""

from __future__ import annotations

import struct
from typing import Final

from deshake.io import exif

__all__ = ["LONGEST", "upright", "with_software"]

LONGEST: Final = 65527
"""Bytes of the longest EXIF block that a JPEG can hold."""


def upright(block: bytes) -> bytes:
    """Return an EXIF block that says orientation 1, for pixels that have been turned.

    Only the value of the tag changes, and the link to the thumbnail, which would now lie on its
    side: it is cut by zeroing the four bytes that point at it. All other bytes stay in place.
    """
    first = exif.read_first(block)
    if first is None or exif.orientation(block) == 1:
        return block
    out = bytearray(block)
    kind, _, raw = first.values[exif.ORIENTATION]
    code = {1: "B", 3: "H", 4: "I"}.get(kind)
    if code is not None:
        place = first.places[exif.ORIENTATION]
        out[place : place + len(raw)] = struct.pack(f"{first.order}{code}", 1)
    if first.next_at + 4 <= len(out):
        out[first.next_at : first.next_at + 4] = bytes(4)
    return bytes(out)


def with_software(block: bytes, software: str) -> bytes:
    """Return an EXIF block whose Software tag is another; a new block if there is none.

    The first directory is written anew behind the block. A block that is not understood, or that
    would then be too long for a JPEG, is returned as it is.
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
    return block if len(out) > LONGEST >= len(block) else bytes(out)
