from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from deshake.formats.photo import read_photo
from deshake.stages.result_file import AS_THE_PHOTO, ResultFile


@pytest.mark.parametrize(
    "wrong", [{"jpeg_quality": 0}, {"jpeg_quality": 101}, {"max_size": 0}, {"max_size": -5}]
)
def test_wrong_numbers_are_refused(wrong):
    with pytest.raises(ValueError, match="is not"):
        ResultFile(**wrong)


def test_the_quality_is_for_jpegs_alone():
    options = ResultFile(jpeg_quality=80, max_size=9)
    assert options.called(Path("a.JPG")) is options
    assert options.called(Path("a.png")) == ResultFile(max_size=9)
    assert ResultFile("JPEG", 80).called(Path("a.png")).jpeg_quality == 80
    assert ResultFile("PNG", 80).called(Path("a.jpg")).jpeg_quality is None


def test_only_what_changes_the_picture_is_in_the_provenance():
    assert AS_THE_PHOTO.provenance() == {}
    assert ResultFile("PNG", keeps_time=True).provenance() == {}
    assert ResultFile(jpeg_quality=5, max_size=9).provenance() == {
        "jpeg_quality": 5,
        "max_size": 9,
    }


def test_the_option_or_else_the_name_decides_the_format(make_codes, save):
    photo = read_photo(save("a.png", make_codes(8, 8, 3)))
    assert AS_THE_PHOTO.format_of(Path("b.jpg"), photo) == "JPEG"
    assert ResultFile("TIFF").format_of(Path("b.jpg"), photo) == "TIFF"


def test_a_large_photo_is_cut_at_white_and_reduced(make_codes, save):
    photo = read_photo(save("a.png", make_codes(40, 60, 3)))
    bright = photo.with_pixels(4 * photo.pixels)
    options = ResultFile(max_size=30)
    assert options.fitted(bright, "PNG").shape == (20, 30)
    assert options.fitted(bright, "PNG").pixels.max() <= 1
    assert ResultFile(max_size=60).fitted(bright, "PNG") is bright
    assert AS_THE_PHOTO.fitted(bright, "PNG") is bright


def test_a_floating_point_tiff_keeps_what_lies_beyond_white(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.full((40, 60), 3, np.float32))
    photo = read_photo(tmp_path / "a.tif")
    options = ResultFile(max_size=30)
    assert options.fitted(photo, "TIFF").pixels == pytest.approx(3)
    assert options.fitted(photo, "PNG").pixels == pytest.approx(1)
