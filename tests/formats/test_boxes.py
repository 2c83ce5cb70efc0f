from __future__ import annotations

import struct

import pytest

from deshake.formats.boxes import canon_exif, metadata_items, read_boxes

CANON = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")


def box(name, content, *, wide=False):
    if wide:
        return struct.pack(">I4sQ", 1, name, len(content) + 16) + content
    return struct.pack(">I4s", len(content) + 8, name) + content


def block(tag, value):
    """Make a TIFF of one directory with one SHORT."""
    return b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, tag, 3, 1, value, 0, 0)


def test_boxes_of_both_sizes_and_a_last_one_without():
    data = box(b"ftyp", b"abcd") + box(b"mdat", b"12345", wide=True)
    data += struct.pack(">I4s", 0, b"free") + b"the rest"
    contents = {name: data[start:end] for name, start, end in read_boxes(data)}
    assert contents == {b"ftyp": b"abcd", b"mdat": b"12345", b"free": b"the rest"}


@pytest.mark.parametrize("size", [1, 4, 7, 100, 1 << 31])
def test_a_damaged_box_ends_the_walk(size):
    data = box(b"ftyp", b"abcd") + struct.pack(">I4s", size, b"oddy") + b"1234"
    assert [name for name, _, _ in read_boxes(data)] == [b"ftyp"]
    assert list(read_boxes(data[:10])) == []


def test_the_exif_of_a_cr3():
    parts = {b"CMT1": block(271, 7), b"CMT2": block(0x8827, 400), b"CMT4": block(5, 1)}
    inner = CANON + b"".join(box(*part) for part in parts.items())
    data = box(b"ftyp", b"crx ") + box(b"moov", box(b"uuid", inner) + box(b"mvhd", b""))
    tree = canon_exif(data)
    assert tree.main == {271: (3, 1, b"\7\0")}
    assert tree.exif == {0x8827: (3, 1, b"\x90\1")}
    assert tree.gps == {5: (3, 1, b"\1\0")}
    assert not canon_exif(box(b"moov", b""))
    assert not canon_exif(b"MM\0*")


@pytest.mark.parametrize("version", [0, 1, 2])
def test_blocks_of_metadata_among_the_items(version):
    content = b"\0\0\0\0II*\0first and second"
    wide = ">I" if version == 2 else ">H"
    place = struct.pack(wide, 7) + (bytes(2) if version else b"") + bytes(2)
    place += struct.pack(">HIIII", 2, 20, 12, 32, len(content) - 12)  # in two parts
    iloc = bytes([version, 0, 0, 0, 0x44, 0]) + struct.pack(wide, 1) + place
    infe = struct.pack(">IHH4s", 2 << 24, 7, 0, b"Exif") + b"\0"
    iinf = bytes(4) + struct.pack(">H", 1) + box(b"infe", infe)
    meta = box(b"meta", bytes(4) + box(b"iinf", iinf) + box(b"iloc", iloc))
    data = box(b"ftyp", b"avif") + box(b"free", content) + meta
    [item] = metadata_items(data)
    assert (item.kind, item.content) == (b"Exif", content)
    assert data[item.at : item.at + 4] == b"Exif"
    for keep in range(len(data)):
        assert metadata_items(data[:keep]) == []
    for size in range(5, len(iloc)):
        cut = box(b"meta", bytes(4) + box(b"iinf", iinf) + box(b"iloc", iloc[:size]))
        assert metadata_items(cut) == []
