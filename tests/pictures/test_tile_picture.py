from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deshake.errors import EstimationError
from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.formats.photo_writing import encode_photo
from deshake.formats.transfer import SRGB
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.metadata.metadata import Metadata
from deshake.pictures.tile_picture import tile_photo, tile_picture

ORANGE, BLUE = (255, 150, 0), (70, 160, 255)
CAMERA = Camera.from_focal(900, 480, 640)


def scene(height=480, width=640):
    """Squares of many shades."""
    coarse = np.random.default_rng(3).random((height // 16 + 1, width // 16 + 1))
    return np.kron(coarse, np.ones((16, 16)))[:height, :width].astype(np.float32)


def pan(length, camera=CAMERA):
    """Turn a camera about Y, by so many pixels."""
    path = np.outer([-length / 2, length / 2], [0, 1, 0]) * grid_steps(camera)
    return RotationKernel.from_path(path, camera)


def where(picture, colour):
    """Pixels that are of a colour, nearly."""
    return np.abs(picture.astype(int) - colour).max(-1) < 40


def photo_of(grey):
    return Photo(
        np.dstack([grey] * 3),
        np.zeros(grey.shape, bool),
        None,
        Encoding("JPEG"),
        Metadata(),
        Path("a.jpg"),
    )


def test_the_photo_is_shown_with_tiles_of_both_kinds_and_a_legend():
    grey = scene()
    picture = tile_picture(grey, CAMERA, pan(12))
    assert picture.dtype == np.uint8
    assert picture.shape[1:] == (640, 3)
    assert 480 < picture.shape[0] < 540
    photo = picture[:480]
    assert where(photo, ORANGE).any()
    assert where(photo, BLUE).any()
    assert where(picture[480:], ORANGE).any()
    assert where(picture[480:], BLUE).any()
    assert (picture[-1] == 255).all()
    shown = np.rint(255 * SRGB.from_linear(grey))
    assert (photo == shown[..., None]).all(-1).mean() > 0.2


def test_filters_are_bright_spots_as_long_as_the_blur_on_dark_squares():
    flat = np.full((480, 640), 0.4, np.float32)
    flat[:, ::40] = 0.5  # something to see
    picture = tile_picture(flat, CAMERA, pan(20))
    still = tile_picture(flat, CAMERA, RotationKernel.delta(CAMERA))
    assert picture[:480].max(-1).min() < 80 < still[:480].max(-1).min()
    bright = (picture[:480] > 230).all(-1)
    assert bright.any()
    assert not (still[:480] > 230).all(-1).any()
    rows, columns = np.nonzero(bright)
    first = np.abs(columns - columns[0]) + np.abs(rows - rows[0]) < 60
    assert np.ptp(columns[first]) > 4 * np.ptp(rows[first])  # a pan is level


def test_a_camera_at_rest_has_tiles_at_full_size_and_no_filters():
    grey = scene()
    picture = tile_picture(grey, CAMERA, RotationKernel.delta(CAMERA))
    photo = picture[:480]
    shown = np.rint(255 * SRGB.from_linear(grey)).astype(int)
    lines = np.any(photo != shown[..., None], -1)
    assert 0.01 < lines.mean() < 0.15  # nothing but the borders of the tiles
    assert where(photo, ORANGE).any()


def test_tiles_lie_in_the_region():
    grey = scene()
    x, y, width, height = region = 320, 100, 280, 260
    photo = tile_picture(grey, CAMERA, pan(6), region)[:480]
    rows, columns = np.nonzero(where(photo, ORANGE) | where(photo, BLUE))
    assert x - 2 <= columns.min() < x + 40
    assert x + width - 40 < columns.max() <= x + width + 2
    assert y - 2 <= rows.min()
    assert rows.max() <= y + height + 2
    part = grey[y : y + height, x : x + width]
    kernel = pan(6)
    alone = tile_picture(part, CAMERA.cropped(*region), kernel.for_camera(CAMERA.cropped(*region)))
    inner = np.s_[20:-20, 20:-20]
    here, there = (
        where(one, ORANGE)[inner] for one in (alone[:height], photo[y : y + height, x : x + width])
    )
    assert (here & there).sum() > 0.7 * max(here.sum(), there.sum())


def test_large_photos_are_reduced_and_wide_blurs_seen_at_a_coarse_scale():
    camera = Camera.from_focal(2210, 1020, 1700)
    grey = scene(1020, 1700)
    picture, other = (tile_picture(grey, camera, pan(width, camera)) for width in (130, 9))
    assert picture.shape[1] == 1600
    assert 960 < picture.shape[0] < 1020
    wide, narrow = (np.nonzero(where(each[:960], ORANGE)) for each in (picture, other))
    assert len(set(wide[1])) != len(set(narrow[1]))


def test_a_uniform_kernel_has_one_filter():
    camera = Camera.uniform(480, 640)
    picture = tile_picture(scene(), CAMERA, pan(12, camera))
    assert where(picture[:480], ORANGE).any()


def test_clipped_tiles_are_not_taken():
    grey = scene(900, 1200)
    camera = Camera.from_focal(1500, 900, 1200)
    clipped = np.zeros(grey.shape, bool)
    clipped[:, :600] = True
    photo = tile_picture(grey, camera, pan(10, camera), clipped=clipped)[:900]
    taken = where(photo, ORANGE)
    assert taken[:, 650:].sum() > 5 * taken[:, :550].sum()


def test_a_photo_becomes_one_of_eight_bits_through_its_lens():
    grey = scene()
    bends = CAMERA.with_lens(np.array([-0.15, 0.02, 0, 0, 0]))
    photo = photo_of(grey)
    plain = tile_photo(photo, pan(12), CAMERA)
    straight = tile_photo(photo, pan(12).for_camera(bends), bends, (20, 20, 600, 440))
    for each in (plain, straight):
        assert each.shape[1] == 640
        assert each.encoding.format == "PNG"
        assert encode_photo(each).startswith(b"\x89PNG")
    drawn = tile_picture(grey, CAMERA, pan(12))
    assert np.array_equal(np.rint(255 * SRGB.from_linear(plain.pixels)), drawn)
    assert not np.array_equal(plain.pixels[:480], straight.pixels[:480])


def test_a_flat_photo_has_no_tiles():
    with pytest.raises(EstimationError, match="no detail"):
        tile_photo(replace(photo_of(np.full((480, 640), 0.5, np.float32))), pan(5), CAMERA)


def test_streaks_stand_in_place_of_tiles_each_with_its_filter_beside_it():
    grey = np.full((480, 640), 0.1, np.float32)
    boxes = np.array([[100.0, 80, 60, 50], [560, 300, 60, 50], [300, 200, 40, 30]])
    picture = tile_picture(grey, CAMERA, pan(20), streaks=boxes)
    photo = picture[:480]
    assert not where(photo, BLUE).any()
    assert where(picture[480:], ORANGE).any()
    for x, y, width, height in boxes.astype(int):
        edges = photo[y - 2 : y + 3, x : x + width], photo[y : y + height, x - 2 : x + 3]
        assert all(
            where(edge, ORANGE).any(0 if n == 0 else 1).all() for n, edge in enumerate(edges)
        )
        inside = photo[y + 4 : y + height - 4, x + 4 : x + width - 4]
        assert np.ptp(inside) == 0  # the streak itself stays visible
    for x in (100 + 60, 560 - 60):  # to the right, or to the left at the border
        beside = photo[80 - 5 : 80 + 55] if x == 160 else photo[300 - 5 : 300 + 55]
        filter_ = (beside[:, x + 3 : x + 57] > 200).all(-1)
        assert 15 <= np.ptp(np.nonzero(filter_)[1]) <= 25  # at the scale of the photo
