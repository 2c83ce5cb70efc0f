from __future__ import annotations

import io
import math
import struct
from typing import TYPE_CHECKING

import piexif
import pytest
from PIL import Image

from deshake.metadata import exif
from deshake.metadata.exif_editing import (
    maker_note_at,
    pointers,
    scaled,
    shortened,
    upright,
    with_size,
    with_software,
    without_thumbnail,
)

if TYPE_CHECKING:
    from collections.abc import Callable


def with_thumbnail(order: str, place: int = 56) -> bytes:
    """Make a block by hand: orientation 6 in IFD0, and an IFD1 with a thumbnail."""
    mark = b"II*\0" if order == "<" else b"MM\0*"
    ifd0 = struct.pack(f"{order}HHHIHHI", 1, 274, 3, 1, 6, 0, 26)
    ifd1 = struct.pack(f"{order}HHHIIHHIII", 2, 513, 4, 1, place, 514, 4, 1, 4, 0)
    return mark + struct.pack(f"{order}I", 8) + ifd0 + ifd1 + b"JPEG"


@pytest.mark.parametrize("order", ["<", ">"])
def test_turning_upright_changes_the_tag_alone(order: str) -> None:
    block = with_thumbnail(order)
    turned = upright(block)
    changed = {at for at, (old, new) in enumerate(zip(block, turned, strict=True)) if old != new}
    assert exif.orientation(block) == 6
    assert exif.orientation(turned) == 1
    assert changed <= {18, 19}


@pytest.mark.parametrize("order", ["<", ">"])
def test_the_thumbnail_is_removed_and_nothing_moves(order: str) -> None:
    block = with_thumbnail(order)
    without = without_thumbnail(block)
    assert b"JPEG" not in without
    assert without[:22] == block[:22]
    assert without[26:] == block[26:-4]
    read = Image.Exif()
    read.load(without)
    assert not read.get_ifd(1)
    more = without_thumbnail(block + b"behind")
    assert more[26:] == block[26:-4] + bytes(4) + b"behind"
    assert without_thumbnail(without) is without


@pytest.mark.parametrize("place", [0, 8, 20, 4_000_000_000])
def test_a_thumbnail_among_used_bytes_destroys_nothing(place: int) -> None:
    without = without_thumbnail(with_thumbnail("<", place))
    assert exif.orientation(without) == 6
    assert without[:22] == with_thumbnail("<")[:22]


def test_sizes_become_those_of_the_picture(make_exif: Callable[..., bytes]) -> None:
    block = make_exif(below={0xA002: 4000, 0xA003: 3000})
    sized = with_size(block, 70_000, 20)
    tags = exif.read_below(sized, exif.read_first(sized), exif.EXIF_POINTER)
    assert tags.numbers(0xA002) == [20]
    wide = tags.values[0xA003][0] == 4
    assert tags.numbers(0xA003) == [70_000 if wide else 3000]  # a SHORT cannot hold it
    assert len(sized) == len(block)
    assert with_size(make_exif(), 7, 8) == make_exif()


def test_a_block_is_shortened_by_its_longest_values(make_exif: Callable[..., bytes]) -> None:
    block = make_exif(below={0x927C: b"m" * 50_000, 0x9286: b"c" * 40_000})
    shorter, dropped = shortened(block, 65527)
    assert dropped == [0x927C]
    assert exif.read_tree(shorter).exif[0x9286] == exif.read_tree(block).exif[0x9286]
    same, dropped = shortened(make_exif() + bytes(70_000), 65527)
    assert dropped == []
    assert exif.read_tree(same) == exif.read_tree(make_exif())
    assert maker_note_at(same) == maker_note_at(make_exif())


def test_pointers_lead_to_directories_that_can_stay(make_exif: Callable[..., bytes]) -> None:
    block = make_exif(">")
    links = pointers(block)
    assert set(links) == {exif.EXIF_POINTER, exif.GPS_POINTER}
    assert links[exif.EXIF_POINTER] == exif.read_first(block).values[exif.EXIF_POINTER]
    assert pointers(b"") is None
    assert pointers(with_software(b"", "x")) is None
    place = maker_note_at(block)
    at = block.index(struct.pack(">I", place))
    assert pointers(block[:at] + b"\xff\xff\xff\xff" + block[at + 4 :]) is None


def test_an_upright_block_is_unchanged(make_exif: Callable[..., bytes]) -> None:
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
def test_software_is_written_and_nothing_else_moves(
    make_exif: Callable[..., bytes], order: str, former: str | None
) -> None:
    block = make_exif(order)
    if former is not None:
        tree = exif.read_tree(block)
        raw = former.encode() + b"\0"
        tree.main[exif.SOFTWARE] = (2, len(raw), raw)
        block = exif.new_block(tree)
    renamed = with_software(block, "deshake 1.2.3")
    assert renamed[8 : len(block)] == block[8:]  # only the header changes
    before, after = Image.Exif(), Image.Exif()
    before.load(block)
    after.load(renamed)
    assert after[305] == "deshake 1.2.3"
    assert {**after, 305: None} == {**before, 305: None}
    assert piexif.load(b"Exif\0\0" + renamed)["0th"][305] == b"deshake 1.2.3"
    assert after.get_ifd(0x8769) == before.get_ifd(0x8769)
    tags = list(exif.read_first(renamed).values)
    assert tags == sorted(tags)


def test_software_without_exif_makes_a_block() -> None:
    read = Image.Exif()
    read.load(with_software(b"", "deshake 1.2.3"))
    assert dict(read) == {305: "deshake 1.2.3"}


def test_a_block_too_long_or_damaged_is_unchanged(make_exif: Callable[..., bytes]) -> None:
    long = make_exif().ljust(exif.LONGEST, b"\0")
    assert with_software(long, "deshake") is long
    assert with_software(b"rubbish", "deshake") == b"rubbish"


def changed_everywhere(block: bytes) -> None:
    block = scaled(with_size(without_thumbnail(upright(block)), 5, 6), 0.3, 0.4)
    pointers(block)
    assert len(shortened(with_software(block, "deshake"), 300)[0]) <= 300


def test_damaged_blocks_do_no_harm(make_exif: Callable[..., bytes]) -> None:
    block = make_exif(orientation=6)
    for size in range(len(block)):
        changed_everywhere(block[:size])
    for at in range(len(block)):
        broken = block[:at] + b"\xff" + block[at + 1 :]
        changed_everywhere(broken)


def test_a_jpeg_with_the_block_is_one(make_exif: Callable[..., bytes]) -> None:
    stream = io.BytesIO()
    renamed = with_software(make_exif(), "deshake 1.2.3")
    Image.new("L", (8, 8)).save(stream, "JPEG", exif=b"Exif\0\0" + renamed)
    assert bytes(piexif.load(stream.getvalue())["Exif"][0x927C]) == b"maker\0note\1\2\3"


@pytest.mark.parametrize(
    ("kind", "code", "value"),
    [(1, "B", [6]), (3, "H", [6]), (4, "I", [6]), (6, "b", [6]), (8, "h", [6]), (9, "i", [6]),
     (5, "II", [12, 2]), (10, "ii", [6, 1]), (11, "f", [6]), (12, "d", [6]), (13, "I", [6])],
)  # fmt: skip
@pytest.mark.parametrize("order", ["<", ">"])
def test_an_orientation_of_any_type_is_reset(
    order: str, kind: int, code: str, value: list[int]
) -> None:
    raw = struct.pack(f"{order}{code}", *value)
    block = exif.new_block(exif.Tree(order, {exif.ORIENTATION: (kind, 1, raw)}))
    assert exif.orientation(block) == 6
    turned = upright(block)
    assert exif.orientation(turned) == 1
    assert exif.read_first(turned).values[exif.ORIENTATION][:2] == (kind, 1)


def test_a_size_that_does_not_fit_its_type_stays() -> None:
    block = exif.new_block(exif.Tree("<", {256: (6, 1, b"\x50")}))
    assert exif.read_first(with_size(block, 9, 200)).numbers(256) == [80]
    assert exif.read_first(with_size(block, 9, 100)).numbers(256) == [100]


@pytest.mark.parametrize(
    ("kind", "code", "value", "half"),
    [(3, "H", [80], [40]), (4, "I", [81], [40]), (5, "II", [81, 2], [20.25]), (11, "f", [9], [4.5]),
     (12, "d", [9], [4.5]), (5, "II", [1, 0], [math.nan]), (9, "i", [-6], [-6]),
     (2, "4s", [b"80"], []),
     (5, "II", [0xFFFFFFFF, 1], [0xFFFFFFFF])],
)  # fmt: skip
@pytest.mark.parametrize("order", ["<", ">"])
def test_the_resolution_of_the_focal_plane_is_reduced(
    order: str, kind: int, code: str, value: list[int], half: list[float]
) -> None:
    raw = struct.pack(f"{order}{code}", *value)
    count = len(raw) if kind == 2 else 1
    tree = exif.Tree(order, {}, {0xA20E: (kind, count, raw), 0xA20F: (kind, count, raw)})
    block = exif.new_block(tree)
    small = scaled(block, 0.5, 1)
    below = exif.read_below(small, exif.read_first(small), exif.EXIF_POINTER)
    assert below.numbers(0xA20E) == pytest.approx(half, nan_ok=True)
    before = exif.read_below(block, exif.read_first(block), exif.EXIF_POINTER)
    assert below.numbers(0xA20F) == pytest.approx(before.numbers(0xA20F), nan_ok=True)
    assert len(small) == len(block)


def test_the_place_of_the_subject_is_reduced_across_and_down() -> None:
    area = 3, 4, struct.pack("<4H", 100, 80, 40, 20)
    block = exif.new_block(exif.Tree("<", {}, {0x9214: area, 0xA214: (3, 2, area[2][:4])}))
    small = scaled(block, 0.5, 0.25)
    below = exif.read_below(small, exif.read_first(small), exif.EXIF_POINTER)
    assert below.numbers(0x9214) == [50, 20, 20, 5]
    assert below.numbers(0xA214) == [50, 20]
    assert scaled(b"", 0.5, 0.5) == b""
