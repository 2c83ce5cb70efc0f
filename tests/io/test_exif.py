from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest
from PIL import Image

from deshake.io import exif

if TYPE_CHECKING:
    from collections.abc import Callable


def with_thumbnail(order: str) -> bytes:
    """Make a block by hand: orientation 6 in IFD0, and an IFD1 with a thumbnail."""
    mark = b"II*\0" if order == "<" else b"MM\0*"
    ifd0 = struct.pack(f"{order}HHHIHHI", 1, 274, 3, 1, 6, 0, 26)
    ifd1 = struct.pack(f"{order}HHHIIHHIII", 2, 513, 4, 1, 56, 514, 4, 1, 4, 0)
    return mark + struct.pack(f"{order}I", 8) + ifd0 + ifd1 + b"JPEG"


@pytest.mark.parametrize("order", ["<", ">"])
def test_turning_upright_changes_the_tag_and_the_link_to_the_thumbnail_alone(order: str) -> None:
    block = with_thumbnail(order)
    turned = exif.upright(block)
    changed = [at for at, (old, new) in enumerate(zip(block, turned, strict=True)) if old != new]
    assert exif.orientation(block) == 6
    assert exif.orientation(turned) == 1
    assert set(changed) <= {18, 19, 22, 23, 24, 25}
    read = Image.Exif()
    read.load(turned)
    assert read[274] == 1
    assert not read.get_ifd(1)


def test_an_upright_block_is_left_alone(make_exif: Callable[..., bytes]) -> None:
    block = make_exif(orientation=1)
    assert exif.upright(block) is block


@pytest.mark.parametrize(("kind", "code"), [(1, "B"), (3, "H"), (4, "I")])
def test_orientation_of_any_integer_type(kind: int, code: str) -> None:
    value = struct.pack(f"<{code}", 8).ljust(4, b"\0")
    block = b"II*\0" + struct.pack("<IHHHI", 8, 1, 274, kind, 1) + value + bytes(4)
    assert exif.orientation(block) == 8
    assert exif.orientation(exif.upright(block)) == 1


@pytest.mark.parametrize("value", [0, 9, 65535])
def test_nonsense_orientation_is_none(value: int) -> None:
    block = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 274, 3, 1, value, 0, 0)
    assert exif.orientation(block) == 1
    assert exif.upright(block) == block


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_tree_survives_being_written_anew(make_exif: Callable[..., bytes], order: str) -> None:
    block = make_exif(order, orientation=3)
    tree = exif.read_tree(block)
    again = exif.new_block(tree)
    assert exif.read_tree(again) == tree
    before, after = Image.Exif(), Image.Exif()
    before.load(block)
    after.load(again)
    for pointer in (0x8769, 0x8825):
        assert dict(after.get_ifd(pointer)) == dict(before.get_ifd(pointer))
    assert after[271] == before[271] == "Canon"
    assert after.get_ifd(0x8769)[0x927C] == b"maker\0note\1\2\3"


def test_tags_about_pixels_are_not_carried() -> None:
    block = b"II*\0" + struct.pack("<IHHHIIHHIHHI", 8, 2, 256, 4, 1, 99, 274, 3, 1, 1, 0, 0)
    assert set(exif.read_tree(block).main) == {274}


def test_no_tags_make_no_block() -> None:
    assert exif.new_block(exif.Tree()) == b""
    assert exif.read_tree(b"") == exif.Tree()


def test_values_repeated_over_and_over_do_not_grow() -> None:
    entries = b"".join(struct.pack("<HHII", tag, 7, 40_000, 0) for tag in range(1000, 4000))
    block = b"II*\0" + struct.pack("<IH", 8, 3000) + entries + bytes(4)
    assert len(block) < 40_000
    assert len(exif.new_block(exif.read_tree(block + bytes(8000)))) < 100_000


def test_damaged_blocks_do_no_harm(make_exif: Callable[..., bytes]) -> None:
    block = make_exif(orientation=6)
    for size in range(len(block)):
        exif.orientation(exif.upright(block[:size]))
        exif.new_block(exif.read_tree(block[:size]))
    for at in range(len(block)):
        broken = block[:at] + b"\xff" + block[at + 1 :]
        exif.upright(broken)
        exif.new_block(exif.read_tree(broken))
