from __future__ import annotations

import io
import struct

import numpy as np
import pytest
import tifffile
from PIL import Image

from deshake.formats.photo import read_photo
from deshake.formats.photo_writing import encode_photo
from deshake.metadata import exif
from deshake.metadata.density import Density, exif_density, jfif_density, phys_density

CODES = np.full((40, 48, 3), 120, np.uint8)


def resolution(data: bytes) -> tuple[float, float]:
    """Read pixels an inch with other libraries."""
    if data[:2] in {b"II", b"MM"}:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            return file.pages[0].get_resolution("inch")
    with Image.open(io.BytesIO(data)) as picture:
        return picture.info["dpi"]


def jfif(data: bytes) -> tuple[int, int, int]:
    assert data[6:11] == b"JFIF\0"
    return struct.unpack_from(">BHH", data, 13)


def saved(path, *, blocks=None, **options):
    Image.fromarray(CODES).save(path, exif=blocks or b"", **options)
    return path


@pytest.mark.parametrize("source", ["a.jpg", "a.png", "a.tif"])
@pytest.mark.parametrize("form", ["JPEG", "PNG", "TIFF"])
@pytest.mark.parametrize("changed", [False, True])
def test_every_format_keeps_the_resolution_of_every_other(tmp_path, source, form, changed):
    photo = read_photo(saved(tmp_path / source, dpi=(300, 240)))
    photo = photo.with_pixels(photo.pixels / 2) if changed else photo
    assert resolution(encode_photo(photo, form)) == pytest.approx((300, 240), abs=0.01)


@pytest.mark.parametrize("unit", [0, 1, 2])
def test_a_jfif_header_keeps_its_unit(tmp_path, unit):
    path = saved(tmp_path / "a.jpg")
    data = path.read_bytes()
    path.write_bytes(data[:13] + struct.pack(">BHH", unit, 118, 59) + data[18:])
    photo = read_photo(path)
    assert jfif(encode_photo(photo.with_pixels(photo.pixels / 2))) == (unit, 118, 59)


def test_a_chunk_of_a_png_is_kept_to_the_last_digit(tmp_path):
    path = saved(tmp_path / "a.png", dpi=(300, 300))
    data = path.read_bytes()
    at = data.index(b"pHYs")
    assert data[at + 4 : at + 13] == struct.pack(">IIB", 11811, 11811, 1)
    assert data[at : at + 17] in encode_photo(read_photo(path))


@pytest.mark.parametrize(("stored", "inch"), [(11811, 300), (2835, 72), (1000, 25.4)])
def test_whole_pixels_an_inch_stay_whole_behind_those_a_metre(stored, inch):
    density = phys_density(struct.pack(">IIB", stored, stored, 1)).per("inch")
    assert density.across == density.down == pytest.approx(inch, abs=1e-9)


def test_where_exif_alone_states_it_the_jfif_header_agrees(tmp_path):
    block = Image.Exif()
    block.update({282: 300.0, 283: 300.0, 296: 2})
    photo = read_photo(saved(tmp_path / "a.jpg", blocks=block))
    assert photo.metadata.density is None
    data = encode_photo(photo.with_pixels(photo.pixels / 2))
    assert jfif(data) == (1, 300, 300)
    assert resolution(encode_photo(photo, "PNG")) == pytest.approx((300, 300), abs=0.01)


def test_tags_state_what_was_read_from_them():
    for order in "<>":
        for density in (Density(300, 299.5), Density(118, 118, "cm"), Density(2, 1, "")):
            tree = exif.Tree(order, density.tags(order))
            assert exif_density(exif.new_block(tree)) == density
    metres = Density(11811, 11811, "m")
    block = exif.new_block(exif.Tree(main=metres.tags("<")))
    assert exif_density(block).across == pytest.approx(299.999, abs=0.001)


def test_missing_and_impossible_densities_are_none():
    assert jfif_density(b"JFIF\0\1\1\0\0\1\0\1\0\0") is None  # pixels are square
    for content in (b"JFIF\0\1\1\1\0\0\0\1\0\0", b"JFIF\0\1\1\7\0\2\0\1\0\0", b"JFXX\0", b""):
        assert jfif_density(content) is None
    for content in (bytes(9), struct.pack(">IIB", 1, 1, 2), b"\1\1", b""):
        assert phys_density(content) is None
    assert phys_density(struct.pack(">IIB", 2, 1, 0)) == Density(2, 1, "")
    odd = {282: (5, 1, bytes(8)), 283: (3, 1, b"\1\0"), 296: (5, 1, bytes(8))}
    assert exif_density(exif.new_block(exif.Tree(main=odd))) is None
    assert exif_density(b"") is None


def test_densities_that_do_not_fit_are_left_out():
    data = io.BytesIO()
    Image.fromarray(CODES).save(data, "JPEG")
    for density in (Density(70_000, 70_000), Density(0.1, 0.1)):
        assert density.in_jfif(data.getvalue()) == data.getvalue()
    assert Density(1e9, 1e9).phys() == b""
