from __future__ import annotations

import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.blind.settings import SETTINGS
from deshake.blind.tile_choice import chosen, covering
from deshake.geometry.camera import Camera
from deshake.signal.pyramid import Pyramid

SIZE = 40


def of(grey: np.ndarray, clipped: np.ndarray | None = None) -> Pyramid:
    return Pyramid(grey.astype(np.float32), Camera.from_focal(300.0, *grey.shape), clipped)


def texture(height: int, width: int, cell: int = 10, seed: int = 0) -> np.ndarray:
    """Squares of random grey: straight edges of both directions everywhere."""
    rng = np.random.default_rng(seed)
    squares = rng.random((-(-height // cell), -(-width // cell)))
    return np.kron(squares, np.ones((cell, cell)))[:height, :width]


def prefer_focus(monkeypatch: pytest.MonkeyPatch, exponent: float) -> None:
    exponents = {"focus": exponent, "isolated_focus": exponent}
    changed = replace(SETTINGS.tile_choice, **exponents)
    monkeypatch.setattr("deshake.blind.tile_choice._S", changed)


def middles(corners: list[tuple[int, int]], size: int = SIZE) -> np.ndarray:
    """Centres (y, x)."""
    return np.array(corners) + size / 2


@pytest.fixture(scope="module")
def photograph() -> np.ndarray:
    grey = cv2.resize(data.camera() / 255, (300, 300), interpolation=cv2.INTER_AREA)
    return (grey**2.2).astype(np.float32)


@pytest.mark.parametrize(("shape", "size"), [((100, 130), 48), ((96, 96), 48), ((50, 160), 50)])
def test_covering_tiles_leave_no_pixel_out(shape, size) -> None:
    seen = np.zeros(shape, int)
    corners = covering(shape, size)
    for y, x in corners:
        assert 0 <= y <= shape[0] - size
        assert 0 <= x <= shape[1] - size
        seen[y : y + size, x : x + size] += 1
    assert seen.min() == 1
    assert len(corners) == np.prod([-(-n // size) for n in shape])


def test_as_many_tiles_as_wanted_lie_within_the_frame_and_apart(photograph) -> None:
    corners = chosen(of(photograph), 0, SIZE, 8, width=6.0)
    assert len(corners) == 8
    places = np.array(corners)
    assert places.min() >= 0
    assert places.max() <= 300 - SIZE
    away = np.abs(places[:, None] - places).max(-1) + SIZE * np.eye(8)
    assert away.min() >= SIZE / 2


def test_the_choice_is_the_same_each_time(photograph) -> None:
    pyramid = of(photograph)
    first = chosen(pyramid, 1, SIZE, 8, width=6.0)
    assert chosen(pyramid, 1, SIZE, 8, width=6.0) == first
    assert chosen(of(photograph), 1, SIZE, 8, width=6.0) == first
    assert chosen(of(photograph), 1, SIZE, 5, width=6.0) == first[:5]


def test_a_choice_does_not_depend_on_the_choices_before(photograph, monkeypatch) -> None:
    """What is kept for later choices is right, also after a choice among few tiles."""
    ways = [
        (focus, {"width": width, "allowed": allowed, "isolated": isolated})
        for width in (6.0, 15.0)
        for allowed in (lambda x, _: x > 0.5, None, lambda _, y: y > 0.5, lambda x, _: x > 9)
        for focus, isolated in ((4.0, False), (0.0, False), (3.0, True))
    ]
    pyramid = of(photograph, np.random.default_rng(0).random(photograph.shape) <= 0.01)
    for level, size in ((0, SIZE), (1, SIZE), (0, 30), (2, 30)):
        for focus, way in ways:
            prefer_focus(monkeypatch, focus)
            fresh = of(photograph, pyramid.at(0).clipped)
            choice = chosen(pyramid, level, size, 8, **way)
            assert choice == chosen(fresh, level, size, 8, **way)


def test_choices_for_many_widths_take_little_memory() -> None:
    grey = texture(600, 800)
    pyramid = of(grey)
    chosen(pyramid, 0, SIZE, 8, width=3.0)
    tracemalloc.start()
    for width in range(10, 40, 5):
        chosen(pyramid, 0, SIZE, 8, width=width)
    kept = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert 0 < kept < 4 * grey.size  # less than one picture


@pytest.mark.parametrize("isolated", [False, True])
def test_exposure_does_not_count(photograph, isolated) -> None:
    dim = chosen(of(photograph / 4), 0, SIZE, 8, width=6.0, isolated=isolated)
    assert dim == chosen(of(photograph), 0, SIZE, 8, width=6.0, isolated=isolated)


def test_an_edge_of_another_direction_is_taken_soon() -> None:
    grey = np.kron(np.random.default_rng(0).random((1, 30)), np.ones((300, 10)))
    grey[200:250, 100:150] = np.kron(np.random.default_rng(1).random((5, 1)), np.ones((10, 50)))
    places = middles(chosen(of(grey), 0, SIZE, 4, width=6.0))
    across = (np.abs(places - [225, 125]) < 45).all(1)
    assert across[:3].any()
    assert not across.all()


def test_tiles_far_from_the_middle_determine_the_roll() -> None:
    for seed in range(3):
        places = middles(chosen(of(texture(320, 320, seed=seed)), 0, SIZE, 4, width=6.0))
        away = np.abs(places - 160).max(1)
        assert away.mean() > 80  # it is 95 for tiles at random
        assert (np.hypot(*(places - 160).T) > 120).sum() >= 3
        assert len({tuple(side) for side in (places > 160).tolist()}) >= 2


@pytest.mark.parametrize("isolated", [False, True])
def test_out_of_focus_tiles_are_avoided(isolated, monkeypatch) -> None:
    grey = texture(300, 400)
    radius = 5
    disk = np.hypot(*np.mgrid[-radius : radius + 1, -radius : radius + 1]) <= radius
    shaken = cv2.blur(grey, (6, 1))
    blurred = cv2.filter2D(shaken, -1, disk / disk.sum())
    for sharp_left in (True, False):
        both = shaken.copy()
        side = np.s_[:, 200:] if sharp_left else np.s_[:, :200]
        both[side] = blurred[side]
        places = middles(chosen(of(both), 0, SIZE, 6, width=6.0, isolated=isolated))
        assert ((places[:, 1] < 200) == sharp_left).all()
        with monkeypatch.context() as without:
            prefer_focus(without, 0.0)
            anywhere = middles(chosen(of(both), 0, SIZE, 6, width=6.0))
        assert ((anywhere[:, 1] < 200) != sharp_left).any()


def test_isolated_edges_are_preferred_to_texture_where_they_are_wanted() -> None:
    grey = np.full((300, 400), 0.3)
    grey[:, :200] = texture(300, 200, cell=5)
    grey[40:120, 240:320] = 0.9
    grey[160:260, 260:360] = 0.8
    for texture_left in (True, False):
        shaken = of(cv2.blur(grey if texture_left else np.fliplr(grey), (6, 6)))
        plain = []
        for isolated in (True, False):
            places = middles(chosen(shaken, 0, SIZE, 6, width=6.0, isolated=isolated))
            plain.append(((places[:, 1] < 200) != texture_left).sum())
        assert plain[0] >= 4 > plain[1]


def test_stronger_edges_are_preferred_where_they_are_isolated() -> None:
    grey = np.full((300, 400), 0.3)
    for n, height in enumerate((0.02, 0.5)):
        grey[60:240, 60 + 200 * n : 140 + 200 * n] += height
    noisy = grey + np.random.default_rng(0).normal(0, 0.001, grey.shape)
    right = [
        (middles(chosen(of(noisy), 0, SIZE, 4, width=6.0, isolated=isolated))[:, 1] > 200).sum()
        for isolated in (False, True)
    ]
    assert right[1] == 4 > right[0]


@pytest.mark.parametrize("isolated", [False, True])
def test_clipped_tiles_are_avoided(isolated) -> None:
    grey = texture(300, 400)
    clipped = np.zeros(grey.shape, bool)
    clipped[:, 200:] = np.random.default_rng(0).random((300, 200)) <= 0.5
    places = middles(chosen(of(grey, clipped), 0, SIZE, 8, width=6.0, isolated=isolated))
    assert (places[:, 1] < 200 + SIZE / 2).all()


@pytest.mark.parametrize("isolated", [False, True])
def test_flat_tiles_come_last(isolated) -> None:
    grey = np.full((300, 400), 0.5)
    grey[100:180, 200:300] = texture(80, 100)
    corners = chosen(of(grey), 0, SIZE, 4, width=6.0, isolated=isolated)
    assert len(corners) == 4
    for y, x in corners:
        assert 100 - SIZE < y < 180
        assert 200 - SIZE < x < 300


def test_edges_shorter_than_the_blur_say_little() -> None:
    grey = texture(300, 400, cell=60)
    grey[:, 200:] = texture(300, 200, cell=2)
    places = middles(chosen(of(grey), 0, SIZE, 6, width=12.0))
    assert (places[:, 1] < 200 + SIZE / 2).all()


def test_only_allowed_tiles_are_taken(photograph) -> None:
    pyramid = of(photograph)
    left = chosen(pyramid, 0, SIZE, 6, width=6.0, allowed=lambda x, _: x < 0.4)
    assert left
    assert (middles(left)[:, 1] < 0.4 * 300).all()
    low = chosen(pyramid, 0, SIZE, 6, width=6.0, allowed=lambda _, y: y > 0.5)
    assert (middles(low)[:, 0] > 0.5 * 300).all()
    none = chosen(pyramid, 0, SIZE, 6, width=6.0, allowed=lambda x, _: np.zeros(x.shape, bool))
    assert none == chosen(pyramid, 0, SIZE, 6, width=6.0)


def test_of_a_large_photo_a_smaller_view_says_where(photograph) -> None:
    large = cv2.resize(photograph, (1200, 1200), interpolation=cv2.INTER_CUBIC)
    corners = chosen(of(large), 0, 4 * SIZE, 5, width=24.0)
    assert max(max(corner) for corner in corners) > 300
    assert max(max(corner) for corner in corners) <= 1200 - 4 * SIZE
    small = np.clip(large[:: 1200 // 300, :: 1200 // 300], 0, 1)
    for y, x in corners:
        tile = small[y // 4 : y // 4 + SIZE, x // 4 : x // 4 + SIZE]
        assert tile.std() > 0.5 * small.std() or np.abs(np.diff(tile)).max() > 0.1
