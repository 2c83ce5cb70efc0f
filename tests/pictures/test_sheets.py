from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.formats.transfer import LINEAR, SRGB
from deshake.metadata.metadata import Metadata
from deshake.pictures import sheets


def test_pictures_get_the_width_asked_for():
    picture = np.zeros((60, 90, 3), np.uint8)
    assert sheets.resized(picture, 30).shape == (20, 30, 3)


def test_the_part_shown_is_the_one_with_detail():
    picture = np.full((120, 160, 3), 90, np.uint8)
    picture[70:110, 100:150] = np.random.default_rng(1).integers(0, 256, (40, 50, 3))
    rows, columns = sheets.detailed_part(picture, 50, 40)
    assert rows.stop - rows.start == 40
    assert columns.stop - columns.start == 50
    assert abs(rows.start - 70) <= 8
    assert abs(columns.start - 100) <= 8


def test_pictures_lie_side_by_side_below_their_caption():
    red, blue = (
        np.full((30, w, 3), c, np.uint8) for w, c in ((40, (255, 0, 0)), (60, (0, 0, 255)))
    )
    page = sheets.sheet([sheets.Row(["one"], [red, blue]), sheets.Row(["two"], [blue])])
    assert page.width == 40 + 60 + 3 * sheets.GAP
    pixels = np.asarray(page)
    assert (pixels == (255, 0, 0)).all(-1).sum() == red.size // 3
    assert (pixels == (0, 0, 255)).all(-1).sum() == 2 * blue.size // 3


def test_a_page_may_be_wider_than_its_pictures():
    assert sheets.sheet([sheets.Row(["none"], [])], 300).width == 300
    assert isinstance(sheets.sheet([], 10), Image.Image)


def test_photos_are_shown_in_colours_of_a_screen():
    light = np.full((4, 5, 3), (0.4, 0.2, 0.1), np.float32)
    swapped = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))

    def shown(**encoding):
        how = Encoding("TIFF", **encoding)
        return sheets.shown(Photo(light, light[..., 0] > 1, None, how, Metadata(), Path("a")))

    want = np.rint(255 * SRGB.from_linear(light))
    for options in ({}, {"depth": 16}, {"depth": 32, "transfer": LINEAR}):
        assert shown(**options).dtype == np.uint8
        assert np.array_equal(shown(**options), want)
    assert np.array_equal(shown(depth=16, matrix=swapped), want[..., ::-1])
