from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest
from PIL import Image

from deshake.metadata import exif
from deshake.metadata.exif_editing import maker_note_at

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_tree_survives_writing_and_reading(make_exif: Callable[..., bytes], order: str) -> None:
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


def test_tags_about_pixels_are_not_copied() -> None:
    block = b"II*\0" + struct.pack("<IHHHIIHHIHHI", 8, 2, 256, 4, 1, 99, 274, 3, 1, 1, 0, 0)
    assert set(exif.read_tree(block).main) == {274}


@pytest.mark.parametrize("place", [9, 700, 60_000])
def test_a_maker_note_keeps_its_place(make_exif: Callable[..., bytes], place: int) -> None:
    tree = exif.read_tree(make_exif(">", orientation=6))
    block = exif.new_block(tree, note_at=place)
    assert maker_note_at(block) == place
    assert block[place:].startswith(b"maker\0note\1\2\3")
    assert exif.read_tree(block) == tree


@pytest.mark.parametrize("place", [None, 3, 65_500, 4_000_000_000])
def test_a_maker_note_moves_if_its_place_is_impossible(
    make_exif: Callable[..., bytes], place: int | None
) -> None:
    tree = exif.read_tree(make_exif())
    block = exif.new_block(tree, note_at=place)
    assert len(block) < 1000
    assert exif.read_tree(block) == tree


def test_no_tags_make_no_block() -> None:
    assert exif.new_block(exif.Tree()) == b""
    assert exif.read_tree(b"") == exif.Tree()


def test_entries_cannot_multiply_the_same_bytes() -> None:
    entries = b"".join(struct.pack("<HHII", tag, 7, 40_000, 0) for tag in range(1000, 4000))
    block = b"II*\0" + struct.pack("<IH", 8, 3000) + entries + bytes(4)
    assert len(block) < 40_000
    assert len(exif.new_block(exif.read_tree(block + bytes(8000)))) < 100_000


def test_damaged_blocks_do_no_harm(make_exif: Callable[..., bytes]) -> None:
    block = make_exif(orientation=6)
    for size in range(len(block)):
        exif.orientation(block[:size])
        exif.new_block(exif.read_tree(block[:size]))
    for at in range(len(block)):
        broken = block[:at] + b"\xff" + block[at + 1 :]
        exif.new_block(exif.read_tree(broken))
