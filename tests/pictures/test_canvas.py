from __future__ import annotations

import numpy as np
import pytest

from deshake.pictures.canvas import Canvas

RED, BLACK = (255, 0, 0), (0, 0, 0)


def ink(picture):
    """Share of ink of each pixel, black being 1."""
    return 1 - picture.mean(-1) / 255


def test_a_canvas_is_as_large_as_asked_and_blank():
    picture = Canvas(30, 20, (10, 20, 30)).finished()
    assert picture.shape == (20, 30, 3)
    assert picture.dtype == np.uint8
    assert (picture == (10, 20, 30)).all()


def test_a_disc_has_its_area_and_its_centre():
    canvas = Canvas(40, 40)
    canvas.disc((13.5, 22.25), 6, BLACK)
    share = ink(canvas.finished())
    assert np.sqrt(share.sum() / np.pi) == pytest.approx(6, abs=0.25)
    y, x = np.mgrid[:40, :40] + 0.5
    assert (share * x).sum() / share.sum() == pytest.approx(13.5, abs=0.05)
    assert (share * y).sum() / share.sum() == pytest.approx(22.25, abs=0.05)


def test_a_rectangle_covers_its_pixels():
    canvas = Canvas(20, 20)
    canvas.rectangle((5, 3), (12, 9), RED)
    picture = canvas.finished()
    assert (picture[4:8, 6:11] == RED).all()
    picture[2:10, 4:13] = 255
    assert (picture == 255).all()


def test_lines_are_anti_aliased():
    canvas = Canvas(40, 40)
    canvas.line((2, 2), (38, 20), BLACK, 1)
    levels = np.unique(canvas.finished())
    assert len(levels) > 5


def test_a_picture_keeps_its_pixels():
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
    canvas = Canvas(20, 16)
    canvas.picture((3, 4), pixels)
    drawn = canvas.finished()
    assert np.array_equal(drawn[4:9, 3:10], pixels)
    drawn[4:9, 3:10] = 255
    assert (drawn == 255).all()


def test_shade_lays_each_cell_in_its_place():
    canvas = Canvas(20, 20)
    canvas.shade(np.array([[1.0, 0.0], [0.0, 0.5]]), ((4, 4), (16, 4), (4, 16)), BLACK)
    share = ink(canvas.finished())
    assert share[4:10, 4:10] == pytest.approx(1, abs=0.01)
    assert share[11:15, 11:15] == pytest.approx(0.5, abs=0.01)
    assert share[4:10, 11:16] == pytest.approx(0, abs=0.01)
    assert share[:3].max() == 0


def test_shade_outside_the_canvas_draws_nothing():
    canvas = Canvas(20, 20)
    canvas.shade(np.ones((2, 2)), ((30, 4), (40, 4), (30, 16)), BLACK)
    assert ink(canvas.finished()).max() == 0


@pytest.mark.parametrize(("anchor", "low", "high"), [("left", 49, 100), ("right", 0, 51)])
def test_text_begins_or_ends_at_its_place(anchor, low, high):
    canvas = Canvas(100, 30)
    canvas.text((50, 15), "12 px", 14, anchor=anchor)
    columns = np.flatnonzero(ink(canvas.finished()).max(0) > 0.1)
    assert len(columns) > 15
    assert low <= columns.min()
    assert columns.max() <= high


def test_theta_is_a_symbol_with_its_subscript():
    pictures = []
    for text in ("θ_X", "θ_Y", "X"):
        canvas = Canvas(60, 40)
        canvas.text((10, 20), text, 24, anchor="left")
        pictures.append(ink(canvas.finished()))
    theta_x, theta_y, x = pictures
    assert theta_x.sum() > 0.8 * x.sum()
    assert (theta_x[:, 10:20] == theta_y[:, 10:20]).all()
    assert (theta_x[:, 20:] != theta_y[:, 20:]).any()
    rows = np.flatnonzero(theta_x[:, 11:19].max(1) > 0.5)
    assert rows.mean() == pytest.approx(20, abs=1)
