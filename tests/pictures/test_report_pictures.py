from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.pictures.report_pictures import report_pictures, room_for

SHAPE = 700, 900


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    """A grey photo with fine detail in its lower right corner."""
    codes = np.full(SHAPE, 90, np.uint8)
    blocks = np.random.default_rng(1).integers(0, 256, (50, 70), np.uint8)
    codes[500:, 620:] = blocks.repeat(4, 0).repeat(4, 1)
    path = tmp_path_factory.mktemp("photo") / "a.png"
    Image.fromarray(codes).save(path)
    return read_photo(path)


@pytest.fixture(scope="module")
def kernel():
    camera = Camera.from_focal(900, *SHAPE)
    return RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera)


def decoded(picture):
    image = Image.open(io.BytesIO(picture.data))
    assert image.size == (picture.width, picture.height)
    return np.asarray(image.convert("L"), float)


def test_before_and_after_are_of_one_size(photo, kernel):
    darker = photo.with_pixels(photo.pixels / 2)
    pictures = report_pictures(photo, darker, kernel, 1_000_000)
    assert pictures.shape == SHAPE
    for one, two in ((pictures.before, pictures.after), (pictures.part, pictures.part_after)):
        before, after = decoded(one), decoded(two)
        assert before.shape == after.shape
        assert after.mean() < 0.8 * before.mean()
    assert pictures.kernel.data.startswith(b"\x89PNG")


def test_with_much_room_the_part_is_the_whole_photo(photo, kernel):
    pictures = report_pictures(photo, photo, kernel, 1_000_000)
    part = decoded(pictures.part)
    assert part.shape == SHAPE
    assert pictures.at == (0, 0)
    codes = np.asarray(Image.open(photo.source), float)
    assert np.abs(part - codes).mean() < 4


def test_the_detail_is_where_the_photo_has_most(photo, kernel):
    for room in (1_000_000, 60_000):
        pictures = report_pictures(photo, photo, kernel, room)
        x, y, width, height = pictures.detail
        assert (width, height) == (360, 270)
        assert 0 <= x <= pictures.part.width - width
        assert 0 <= y <= pictures.part.height - height
        left, top = pictures.at[0] + x, pictures.at[1] + y
        assert left + width > 800
        assert top + height > 650
        # What the part has at the detail is what the photo has there.
        codes = np.asarray(Image.open(photo.source), float)
        seen = decoded(pictures.part)[y : y + height, x : x + width]
        assert np.abs(seen - codes[top : top + height, left : left + width]).mean() < 12


@pytest.mark.parametrize("room", [300_000, room_for(300)])
def test_the_room_is_kept_whatever_the_photo(kernel, photo, room):
    rng = np.random.default_rng(2)
    noise = photo.with_pixels(rng.random(SHAPE, np.float32))
    pictures = report_pictures(noise, noise, kernel, room)
    parts = (pictures.before, pictures.after, pictures.part, pictures.part_after, pictures.kernel)
    assert sum(len(part.data) for part in parts) <= room
    assert pictures.part.width >= 360


def test_what_is_left_as_it_is_has_no_after_and_no_kernel(photo, kernel):
    still = RotationKernel.delta(kernel.camera)
    pictures = report_pictures(photo, photo, still, 200_000)
    assert (pictures.after, pictures.part_after, pictures.kernel) == (None, None, None)
    assert pictures.before.width == 900


def test_a_tiny_photo_has_its_pictures_too(tmp_path):
    Image.new("RGB", (7, 5), "teal").save(tmp_path / "tiny.png")
    photo = read_photo(tmp_path / "tiny.png")
    kernel = RotationKernel.from_path([(0, -0.1, 0), (0, 0.1, 0)], Camera.from_focal(8, 5, 7))
    pictures = report_pictures(photo, photo, kernel, 20_000)
    assert (pictures.part.width, pictures.part.height) == (7, 5)
    assert pictures.detail == (0, 0, 7, 5)


def test_three_hundred_photos_stay_below_60_megabytes():
    assert 300 * room_for(300) * 4 / 3 < 55e6
    assert room_for(1) == room_for(2) > room_for(300) > room_for(100_000) > 0
    assert room_for(300, beside=True) == room_for(1, beside=True) > room_for(1)
