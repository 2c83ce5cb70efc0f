from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deshake.errors import OutputError
from deshake.formats.conversion import converted, encoded, lost, output_format
from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.formats.transfer import LINEAR, SRGB
from deshake.metadata.metadata import Metadata

GREY = np.full((4, 4), 0.5, np.float32)


def photo(form, source):
    return Photo(GREY, GREY > 1, None, Encoding(form, grey=True), Metadata(), Path(source))


def test_the_ending_decides_unless_it_is_the_sources():
    png = photo("PNG", "a.jpg")
    assert output_format("out.JPG", png.source, png.encoding) == "PNG"
    assert output_format("out.jpeg", png.source, png.encoding) == "JPEG"
    assert output_format("out.tiff", png.source, png.encoding) == "TIFF"
    for name in ("out.bmp", "out"):
        with pytest.raises(OutputError, match=r"ending|ends in"):
            output_format(name, png.source, png.encoding)


def test_the_quality_of_a_jpeg_is_kept():
    heic = Encoding("HEIF", depth=16, bits=10, quality=70)
    assert converted(heic, "JPEG").quality == 70
    assert converted(Encoding("PNG"), "JPEG").quality == 95
    assert "a HEIC of 10 bits, written as a JPEG of quality 70 " in lost(heic, "JPEG")[0]


@pytest.mark.parametrize("form", ["RAW", "HEIF"])
def test_formats_that_are_only_read_become_others(form):
    for name in ("out.dng", "out.NEF", "out.heic"):
        with pytest.raises(OutputError, match="read, but not written"):
            output_format(name, Path("a.dng"), Encoding(form))
    assert output_format("out.tif", Path("a.tif"), Encoding(form)) == "TIFF"


def test_depth_is_kept_where_the_format_has_it():
    deep = Encoding("RAW", depth=16, transfer=LINEAR, matrix=((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    for form, depth in {"TIFF": 16, "PNG": 16, "JPEG": 8, "WEBP": 8}.items():
        assert converted(deep, form).depth == depth
        assert converted(deep, form).transfer is LINEAR
        assert converted(deep, form).matrix == deep.matrix
    assert converted(Encoding("PNG"), "WEBP").lossless
    assert not converted(Encoding("JPEG"), "WEBP").lossless


def test_the_matrix_comes_before_the_curve_and_clipping():
    matrix = ((2.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.5, 0.0, 0.5))
    pixels = np.random.default_rng(0).random((600, 7, 3)).astype(np.float32) * 1.5
    encoding = Encoding("TIFF", depth=16, matrix=matrix)
    want = np.clip(pixels @ np.array(matrix, np.float32).T, 0, 1)
    codes = encoded(pixels, encoding)
    assert np.abs(codes / 65535 - SRGB.from_linear(want)).max() < 1e-5
    grey = encoded(pixels[..., 0], encoding)  # the matrix does not apply
    assert np.array_equal(grey, encoded(pixels[..., 0], replace(encoding, matrix=None)))


def test_the_losses_of_a_heic_are_reported():
    assert lost(Encoding("PNG", depth=16), "JPEG") == []
    assert lost(Encoding("HEIF"), "TIFF") == []
    assert "quality 95" in lost(Encoding("HEIF"), "JPEG")[0]
    assert "10 bits" in lost(Encoding("HEIF", depth=16, bits=10), "JPEG")[0]


def test_texts_of_the_format_are_lost_in_another():
    comment = Encoding("JPEG", carried=b"\xff\xfe\0\4hi")
    assert lost(comment, "JPEG") == []
    assert "left out of a PNG" in lost(comment, "PNG")[0]
    assert lost(Encoding("PNG", carried=b"\0\0\0\0pHYs"), "TIFF") == []
    assert "left out of a TIFF" in lost(Encoding("PNG", carried=b"\0\0\0\0tEXt"), "TIFF")[0]


def test_clipping_of_values_above_white_is_reported():
    deep = Encoding("TIFF", depth=32)
    assert lost(deep, "TIFF") == []
    assert "beyond white" in lost(deep, "PNG")[0]
    assert converted(deep, "PNG").depth == converted(deep, "AVIF").depth == 16
    assert converted(deep, "AVIF").bits == 10
    assert converted(deep, "JPEG").depth == 8
