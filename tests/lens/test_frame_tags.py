from __future__ import annotations

import io
from typing import TYPE_CHECKING

import pytest
from PIL import Image

from deshake.lens.focal_length import focal_length
from deshake.lens.frame_tags import reframed
from deshake.metadata import exif
from deshake.metadata.metadata import Metadata

if TYPE_CHECKING:
    from collections.abc import Callable

TAGS = {0xA002: 2592, 0xA003: 1944, 0xA20E: 11520.0, 0xA20F: 11502.96, 0xA210: 2, 0xA405: 35}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("below", [TAGS, {0xA405: 35}, {0xA404: 2.0}, {}])
@pytest.mark.parametrize("size", [(1700, 2000), (1884, 2532), (972, 1296), (500, 500)])
def test_a_crop_has_the_focal_length_of_its_photo(
    make_exif: Callable[..., bytes], order: str, below: dict[int, float], size: tuple[int, int]
) -> None:
    metadata = Metadata(exif=make_exif(order, below=below))
    focal = 2627 * (0.5 if size == (972, 1296) else 1)
    new_metadata = reframed(metadata, *size, focal)
    again = focal_length(new_metadata, *size)
    assert again.pixels == pytest.approx(focal, rel=2e-4)
    assert "contradict" not in "".join(again.notes)


def test_other_tags_and_the_maker_note_stay(make_exif: Callable[..., bytes]) -> None:
    block = make_exif(below=TAGS)
    changed = reframed(Metadata(exif=block, xmp=b"x"), 100, 200, 300.0)
    assert changed.xmp == b"x"
    assert changed.exif[8 : len(block)] == block[8:]
    read = Image.Exif()
    read.load(changed.exif)
    below = read.get_ifd(0x8769)
    assert (below[0xA002], below[0xA003]) == (200, 100)
    assert float(below[0xA20E]) == pytest.approx(10 * 300 / 5.8)
    assert 0xA405 not in below
    assert below[0x927C] == b"maker\0note\1\2\3"
    assert read.get_ifd(0x8825)[1] == "N"
    assert read[0x0110] == "Canon DIGITAL IXUS 70"


def test_the_equivalent_alone_is_rounded(make_exif: Callable[..., bytes]) -> None:
    exif_block = make_exif(below={0xA405: 28, 0x920A: 0.0})
    result = focal_length(reframed(Metadata(exif=exif_block), 300, 400, 330.0), 300, 400)
    assert result.pixels == pytest.approx(330, rel=0.5 / 28)


def test_metadata_without_room_or_without_exif_stay(make_exif: Callable[..., bytes]) -> None:
    assert reframed(Metadata(), 10, 10, 10.0) == Metadata()
    bare = Image.Exif()
    bare[0x010F] = "Canon"
    metadata = Metadata(exif=bare.tobytes().removeprefix(b"Exif\0\0"))
    assert reframed(metadata, 10, 10, 10.0) is metadata
    full = Metadata(exif=make_exif(below={0x927C: bytes(40_000)}))
    assert reframed(full, 10, 10, 10.0) is full


def test_a_jpeg_holds_it(make_exif: Callable[..., bytes]) -> None:
    stream = io.BytesIO()
    block = reframed(Metadata(exif=make_exif(below=TAGS)), 10, 20, 30.0).exif
    Image.new("L", (20, 10)).save(stream, "JPEG", exif=b"Exif\0\0" + block)
    assert exif.read_tree(block).exif[0xA002][2] == b"\x14\0\0\0"
    with Image.open(stream) as image:
        assert image.getexif().get_ifd(0x8769)[0xA003] == 10
