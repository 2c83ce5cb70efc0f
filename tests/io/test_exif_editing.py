from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING

import piexif
import pytest
from PIL import Image

from deshake.io import exif
from deshake.io.exif_editing import LONGEST, upright, with_software

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
    turned = upright(block)
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
    assert upright(block) is block


@pytest.mark.parametrize(("kind", "code"), [(1, "B"), (3, "H"), (4, "I")])
def test_orientation_of_any_integer_type(kind: int, code: str) -> None:
    value = struct.pack(f"<{code}", 8).ljust(4, b"\0")
    block = b"II*\0" + struct.pack("<IHHHI", 8, 1, 274, kind, 1) + value + bytes(4)
    assert exif.orientation(block) == 8
    assert exif.orientation(upright(block)) == 1


@pytest.mark.parametrize("value", [0, 9, 65535])
def test_nonsense_orientation_is_none(value: int) -> None:
    block = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 274, 3, 1, value, 0, 0)
    assert exif.orientation(block) == 1
    assert upright(block) == block


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("former", [None, "x", "a camera's firmware of some length"])
def test_software_is_told_and_nothing_else_moves(
    make_exif: Callable[..., bytes], order: str, former: str | None
) -> None:
    block = make_exif(order)
    if former is not None:
        tree = exif.read_tree(block)
        raw = former.encode() + b"\0"
        tree.main[exif.SOFTWARE] = (2, len(raw), raw)
        block = exif.new_block(tree)
    told = with_software(block, "deshake 1.2.3")
    assert told[8 : len(block)] == block[8:]  # the header alone points elsewhere
    before, after = Image.Exif(), Image.Exif()
    before.load(block)
    after.load(told)
    assert after[305] == "deshake 1.2.3"
    assert {**after, 305: None} == {**before, 305: None}
    assert piexif.load(b"Exif\0\0" + told)["0th"][305] == b"deshake 1.2.3"
    assert after.get_ifd(0x8769) == before.get_ifd(0x8769)
    tags = list(exif.read_first(told).values)
    assert tags == sorted(tags)


def test_software_without_exif_makes_a_block() -> None:
    read = Image.Exif()
    read.load(with_software(b"", "deshake 1.2.3"))
    assert dict(read) == {305: "deshake 1.2.3"}


def test_a_block_too_long_or_not_understood_is_left_alone(make_exif: Callable[..., bytes]) -> None:
    long = make_exif().ljust(LONGEST, b"\0")
    assert with_software(long, "deshake") is long
    assert with_software(b"rubbish", "deshake") == b"rubbish"


def test_damaged_blocks_do_no_harm(make_exif: Callable[..., bytes]) -> None:
    block = make_exif(orientation=6)
    for size in range(len(block)):
        exif.read_tree(with_software(upright(block[:size]), "deshake"))
    for at in range(len(block)):
        broken = block[:at] + b"\xff" + block[at + 1 :]
        exif.read_tree(with_software(upright(broken), "deshake"))


def test_a_jpeg_with_the_block_is_one(make_exif: Callable[..., bytes]) -> None:
    stream = io.BytesIO()
    told = with_software(make_exif(), "deshake 1.2.3")
    Image.new("L", (8, 8)).save(stream, "JPEG", exif=b"Exif\0\0" + told)
    assert bytes(piexif.load(stream.getvalue())["Exif"][0x927C]) == b"maker\0note\1\2\3"
