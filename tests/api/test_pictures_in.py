from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import deshake
from deshake.api.pictures_in import as_photo, pixels_of
from deshake.errors import PhotoError


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, ">f4"])
@pytest.mark.parametrize("shape", [(20, 30), (20, 30, 3)])
def test_an_array_becomes_a_photo(shape, dtype):
    array = np.linspace(0, 1.25, int(np.prod(shape))).reshape(shape).astype(dtype)
    photo = as_photo(array)
    assert photo.pixels.dtype == np.float32
    assert np.array_equal(photo.pixels, array.astype(np.float32))
    white = array >= 1
    assert np.array_equal(photo.clipped, white if len(shape) == 2 else white.any(-1))
    assert photo.encoding.grey == (len(shape) == 2)
    assert photo.sha256 is None


def test_a_photo_stays_what_it_is(tmp_path):
    deshake.write_photo(tmp_path / "a.png", np.full((20, 30), 0.5))
    photo = deshake.read_photo(tmp_path / "a.png")
    assert as_photo(photo) is photo


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (np.zeros((20, 30), np.uint8), "the array: has the type uint8"),
        (np.zeros((20, 30), np.int64), "the array: has the type int64"),
        (np.zeros((20, 30), bool), "the array: has the type bool"),
        (np.zeros((20, 30), complex), "the array: has the type complex128"),
        (None, "the array: has the type object"),
        (np.zeros(20), r"the array: has the shape \(20,\), not \(H, W\)"),
        (np.zeros((20, 30, 4)), r"the array: has the shape \(20, 30, 4\)"),
        (np.zeros((3, 20, 30)), r"the array: has the shape \(3, 20, 30\)"),
        (np.zeros((2, 20, 30, 3)), r"the array: has the shape \(2, 20, 30, 3\)"),
        (np.zeros((0, 30)), r"the array: has no pixels"),
        (np.full((20, 30), np.nan), "the array: has pixels that are not finite"),
        (np.full((20, 30), -np.inf), "the array: has pixels that are not finite"),
        (np.full((20, 30), 1e300), "the array: has pixels that are not finite"),
        ("photo.jpg", "'photo.jpg' is a name, not a picture"),
        (Path("photo.jpg"), "'photo.jpg' is a name, not a picture"),
    ],
)
def test_what_is_no_picture_is_refused_in_one_line(wrong, said):
    with pytest.raises(PhotoError, match=said) as caught:
        as_photo(wrong)
    assert "\n" not in str(caught.value)


def test_a_photo_that_is_not_finite_is_refused(tmp_path):
    deshake.write_photo(tmp_path / "a.png", np.full((20, 30), 0.5))
    photo = deshake.read_photo(tmp_path / "a.png")
    with pytest.raises(PhotoError, match=r"a\.png: has pixels that are not finite"):
        as_photo(photo.with_pixels(photo.pixels * np.nan))


def test_a_result_shares_no_memory_with_what_was_given():
    array = np.full((20, 30), 0.5, np.float32)
    pixels = pixels_of(as_photo(array), array)
    assert np.array_equal(pixels, array)
    assert not np.shares_memory(pixels, array)
