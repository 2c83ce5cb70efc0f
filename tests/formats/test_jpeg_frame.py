from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from skimage import data

from deshake.formats.jpeg_frame import Frame, frame_of, with_frame
from deshake.formats.photo import read_photo
from deshake.formats.photo_writing import encode_photo

PHOTO = data.astronaut()[60:141, 180:277]


def jpeg(codes: np.ndarray, **options: object) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(codes).save(stream, "JPEG", **options)
    return stream.getvalue()


def opened(file: bytes) -> Image.Image:
    return Image.open(io.BytesIO(file))


@pytest.mark.parametrize("subsampling", [0, 1, 2])
@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("codes", [PHOTO, PHOTO[..., 0]], ids=["colour", "grey"])
def test_a_frame_decodes_to_the_same_codes_under_other_metadata(codes, progressive, subsampling):
    old = jpeg(
        codes,
        quality=88,
        subsampling=subsampling,
        progressive=progressive,
        restart_marker_rows=1,
        comment=b"old",
        exif=b"Exif\0\0II*\0old",
    )
    new = with_frame(jpeg(codes[:8, :8], comment=b"new", icc_profile=b"p" * 70_000), frame_of(old))
    picture = opened(new)
    assert np.array_equal(np.asarray(picture), np.asarray(opened(old)))
    assert picture.info["comment"] == b"new"
    assert picture.info["icc_profile"] == b"p" * 70_000
    assert b"old" not in new
    assert new[:11] == b"\xff\xd8\xff\xe0\x00\x10JFIF\0"


def test_only_the_first_picture_is_taken_and_only_to_its_end():
    first, second = jpeg(PHOTO), jpeg(PHOTO[::-1])
    assert frame_of(first + second) == frame_of(first)
    assert frame_of(first).endswith(b"\xff\xd9")


def test_a_file_without_an_end_has_no_frame():
    whole = jpeg(PHOTO)
    for length in (0, 2, 3, 20, 200, len(whole) // 2, len(whole) - 1):
        assert frame_of(whole[:length]) == b""


@given(st.binary(max_size=300))
def test_damaged_bytes_raise_no_error(junk):
    assert isinstance(frame_of(b"\xff\xd8" + junk), bytes)
    whole = bytearray(jpeg(PHOTO[:16, :16]))
    whole[30 : 30 + len(junk)] = junk
    assert isinstance(frame_of(bytes(whole)), bytes)


def test_a_frame_belongs_to_its_own_pixels_only():
    pixels = np.zeros((2, 2), np.float32)
    frame = Frame(b"data", pixels)
    assert frame.of(pixels) == b"data"
    assert frame.of(pixels.copy()) == b""


@pytest.mark.parametrize("orientation", [1, 6])
def test_photos_that_are_unchanged_keep_their_codes(tmp_path, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "a.jpg"
    Image.fromarray(PHOTO).save(path, quality=90, exif=exif)
    photo = read_photo(path)
    same = np.asarray(opened(encode_photo(photo)))
    upright = np.asarray(Image.open(path).transpose(Image.Transpose.ROTATE_270))
    if orientation == 1:
        assert np.array_equal(same, np.asarray(Image.open(path)))
    else:  # turned pixels must be encoded again
        assert photo.frame is None
        assert same.shape == upright.shape
    half = opened(encode_photo(photo.with_pixels(photo.pixels / 2)))
    assert np.asarray(half).mean() < 0.9 * same.mean()
    assert opened(encode_photo(photo, "PNG")).format == "PNG"
