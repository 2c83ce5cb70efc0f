from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from deshake.errors import PhotoError
from deshake.formats.photo import read_photo
from deshake.formats.photo_writing import encode_photo
from deshake.formats.transfer import encode
from deshake.stages.blending import blended, find_mask, fit_mask, read_mask


@pytest.fixture(params=[np.uint8, np.uint16])
def photo(request, tmp_path):
    """A grey photo of all codes, or of every 16th of 16 bits, as a PNG."""
    top = np.iinfo(request.param).max
    codes = np.linspace(0, top, 64 * 96).astype(request.param).reshape(64, 96)
    Image.fromarray(codes).save(tmp_path / "photo.png")
    return read_photo(tmp_path / "photo.png")


@pytest.fixture
def result(photo):
    noise = np.random.default_rng(0).normal(0, 0.3, photo.pixels.shape)
    return photo.with_pixels(photo.pixels + noise)


@pytest.fixture
def mask_file(tmp_path):
    def save(codes, name="mask.png", **options):
        Image.fromarray(np.asarray(codes, np.uint8)).save(tmp_path / name, **options)
        return tmp_path / name

    return save


def codes(photo):
    return encode(photo.pixels, photo.encoding.transfer, photo.encoding.depth)


def test_kept_pixels_keep_their_codes(photo, result):
    mask = np.zeros(photo.shape, np.float32)
    mask[:30] = 1
    mixed = codes(blended(photo, result, mask=mask))
    assert np.array_equal(mixed[:30], codes(photo)[:30])
    assert np.array_equal(mixed[30:], codes(result)[30:])
    assert np.array_equal(codes(blended(photo, result, strength=0)), codes(photo))
    assert encode_photo(blended(photo, result, strength=0)) == encode_photo(photo)


def test_all_of_a_result_is_the_result_itself(photo, result):
    assert blended(photo, result) is result
    none = np.zeros(photo.shape, np.float32)
    assert np.array_equal(blended(photo, result, mask=none).pixels, result.pixels)
    assert blended(photo, photo, strength=0.5) is photo


def test_none_of_a_result_is_the_photo_itself(photo, result):
    assert blended(photo, result, strength=0) is photo
    assert blended(photo, result, mask=np.ones(photo.shape, np.float32)) is photo


def test_mixes_linear_light_clipped(photo, result):
    mask = np.full(photo.shape, 0.5, np.float32)
    expected = photo.pixels + 0.25 * (np.clip(result.pixels, 0, 1) - photo.pixels)
    mixed = blended(photo, result, strength=0.5, mask=mask)
    assert np.allclose(mixed.pixels, expected, atol=1e-6)


def test_all_colours_share_a_mask(tmp_path):
    colours = np.random.default_rng(1).integers(0, 256, (300, 20, 3)).astype(np.uint8)
    Image.fromarray(colours).save(tmp_path / "colour.png")
    photo = read_photo(tmp_path / "colour.png")
    result = photo.with_pixels(1 - photo.pixels)
    mask = np.zeros(photo.shape, np.float32)
    mask[::2] = 1
    mixed = blended(photo, result, mask=mask).pixels
    assert np.array_equal(mixed[::2], photo.pixels[::2])
    assert np.array_equal(mixed[1::2], result.pixels[1::2])


def test_a_mask_is_shares_of_white(photo, mask_file):
    ramp = np.tile(np.linspace(0, 255, 96).astype(np.uint8), (64, 1))
    for name, options in (("a.png", {}), ("b.jpg", {"quality": 100})):
        kept = read_mask(mask_file(ramp, name, **options), photo).share
        assert kept.dtype == np.float32
        assert kept == pytest.approx(ramp / 255, abs=0.01)
    colours = np.repeat(ramp[..., None], 3, 2)
    assert np.array_equal(
        read_mask(mask_file(colours), photo).share, read_mask(mask_file(ramp), photo).share
    )
    opaque = np.dstack([colours, np.full_like(ramp, 255)])
    assert np.array_equal(
        read_mask(mask_file(opaque), photo).share, read_mask(mask_file(ramp), photo).share
    )


@pytest.mark.parametrize("shape", [(32, 48), (128, 192), (21, 32)])
def test_a_mask_may_be_scaled(photo, mask_file, shape):
    half = np.zeros(shape, np.uint8)
    half[: shape[0] // 2] = 255
    kept = read_mask(mask_file(half), photo).share
    assert kept.shape == photo.shape
    assert (kept[:28] == 1).all()
    assert (kept[36:] == 0).all()


@pytest.mark.parametrize(
    ("codes", "says"),
    [
        (np.zeros((64, 90)), "the mask has 90 x 64 pixels, and "),
        (np.zeros((96, 64)), "the mask has 64 x 96 pixels, and "),
        (np.full((64, 96, 3), (255, 0, 0)), "has colours"),
        (np.full((64, 96, 4), (255, 255, 255, 100)), "transparent parts"),
    ],
)
def test_what_is_no_mask_of_the_photo_is_refused(photo, mask_file, codes, says):
    path = mask_file(codes)
    with pytest.raises(PhotoError, match=says) as caught:
        read_mask(path, photo)
    assert caught.value.file == str(path)
    assert caught.value.hint


def test_a_turned_mask_is_an_error(photo, mask_file):
    with pytest.raises(PhotoError) as caught:
        read_mask(mask_file(np.zeros((96, 64))), photo)
    assert "upright" in caught.value.hint


def test_scaling_keeps_to_shares():
    steps = np.kron(np.random.default_rng(0).integers(0, 2, (6, 9)), np.ones((7, 7)))
    scaled = fit_mask(steps.astype(np.float32), (25, 40))
    assert scaled.shape == (25, 40)
    assert scaled.min() >= 0
    assert scaled.max() <= 1


def test_masks_in_a_folder_go_by_stem(mask_file, tmp_path):
    mask_file(np.zeros((4, 4)), "one.png")
    mask_file(np.zeros((4, 4)), "two.png")
    mask_file(np.zeros((4, 4)), "two.jpg")
    (tmp_path / "one.txt").touch()
    (tmp_path / "three.png").mkdir()
    assert find_mask(tmp_path, tmp_path / "in" / "one.jpg") == tmp_path / "one.png"
    assert find_mask(tmp_path, tmp_path / "three.jpg") is None
    with pytest.raises(PhotoError, match=r"two\.jpg and two\.png could both be its mask"):
        find_mask(tmp_path, tmp_path / "two.tif")
