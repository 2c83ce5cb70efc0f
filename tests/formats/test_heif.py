from __future__ import annotations

import sys

import numpy as np
import pytest
from support.heic_writer import heic

from deshake.errors import PhotoError
from deshake.formats.heif import decode_heif
from deshake.formats.photo import read_photo
from deshake.formats.photo_writing import encode_photo


def picture(depth=8, height=48, width=64):
    rng = np.random.default_rng(0)
    squares = rng.integers(0, 1 << depth, (height // 2, width // 2, 3))
    return np.kron(squares, np.ones((2, 2, 1), int))


@pytest.mark.parametrize("depth", [8, 10])
def test_the_picture_is_decoded(depth):
    codes = picture(depth)
    decoded = decode_heif(heic(codes, depth=depth))
    assert decoded.encoding.format == "HEIF"
    assert decoded.encoding.depth == (8 if depth == 8 else 16)
    assert decoded.encoding.bits == (0 if depth == 8 else 10)
    values = decoded.codes / np.iinfo(decoded.codes.dtype).max * ((1 << depth) - 1)
    assert np.abs(values - codes).max() < 2.1  # YCbCr's rounding
    assert np.abs(values - codes).mean() < 0.5
    assert decoded.codes.max() == np.iinfo(decoded.codes.dtype).max
    assert decoded.notes == ()


@pytest.mark.parametrize("turns", range(4))
def test_the_file_decides_the_orientation_not_its_exif(make_exif, turns):
    codes = picture()
    decoded = decode_heif(heic(codes, exif=make_exif(orientation=6), turns=turns))
    assert np.abs(decoded.codes.astype(int) - np.rot90(codes, turns)).max() <= 2
    assert decoded.metadata.orientation == 1


def test_metadata(make_exif, make_icc, xmp):
    icc = make_icc(b"curv" + bytes(8))
    metadata = decode_heif(heic(picture(), exif=make_exif(), xmp=xmp, icc=icc)).metadata
    assert (metadata.exif, metadata.xmp, metadata.icc) == (make_exif(), xmp, icc)
    assert metadata.tags().focal_mm == pytest.approx(5.8)


def test_code_numbers_of_colours_become_a_profile():
    assert decode_heif(heic(picture())).metadata.icc == b""
    p3 = decode_heif(heic(picture(), colours=(12, 13))).metadata.icc
    assert "Primaries 12".encode("utf-16-be") in p3
    with pytest.raises(PhotoError, match=r"HDR picture \(PQ\)"):
        decode_heif(heic(picture(10), depth=10, colours=(9, 16)))


def test_a_dropped_gain_map_is_noted():
    data = heic(picture(), auxiliary=b"urn:com:apple:photo:2020:aux:hdrgainmap")
    assert decode_heif(data).notes == ("its gain map (HDR) is dropped",)


@pytest.mark.parametrize("depth", [8, 10])
def test_the_result_is_another_format(tmp_path, depth):
    path = tmp_path / "a.heic"
    path.write_bytes(heic(picture(depth), depth=depth))
    photo = read_photo(path)
    assert encode_photo(photo).startswith(b"\xff\xd8\xff")
    path = tmp_path / "a.tif"
    path.write_bytes(encode_photo(photo, "TIFF"))
    assert read_photo(path).encoding.depth == photo.encoding.depth
    assert np.array_equal(read_photo(path).pixels, photo.pixels)


@pytest.mark.parametrize("keep", [0.02, 0.06, 0.3, 0.9, 0.999])
def test_files_cut_short_are_refused(keep):
    data = heic(picture())
    with pytest.raises(PhotoError, match="damaged"):
        decode_heif(data[: int(keep * len(data))])


def test_without_the_package_the_hint_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pi_heif", None)
    with pytest.raises(PhotoError) as caught:
        decode_heif(heic(picture()))
    assert caught.value.hint == "pip install 'deshake[heif]'"
