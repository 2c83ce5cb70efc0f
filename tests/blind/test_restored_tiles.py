from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.restored_tiles import gradient_price, restored
from deshake.blind.tiles import Tiles
from deshake.geometry.rotations import reach
from deshake.signal.pyramid import Scale

CORNERS = [(30, 40), (60, 100)]
SIZE = 64


def cut(picture: np.ndarray, shaken) -> Tiles:
    far = reach(shaken.camera, shaken.kernel.theta)
    return Tiles(Scale(picture, shaken.camera, None, 2.0), CORNERS, SIZE, far)


def middles(blocks: np.ndarray, tiles: Tiles) -> np.ndarray:
    return blocks[tiles.inside].reshape(tiles.count, -1)


def test_a_restored_tile_is_nearer_to_the_sharp_one(shaken) -> None:
    tiles = cut(shaken.grey, shaken)
    sharp = cut(np.ascontiguousarray(shaken.still), shaken)
    pictures = restored(tiles.bound(shaken.kernel), gradient_price(tiles))
    errors = [np.std(middles(one - sharp.g, tiles), axis=1) for one in (pictures, tiles.g)]
    assert np.all(errors[0] < 0.85 * errors[1])


def test_a_higher_price_gives_a_smoother_picture(shaken) -> None:
    tiles = cut(shaken.grey, shaken)
    price = gradient_price(tiles)
    lengths = [
        np.abs(np.diff(restored(tiles.bound(shaken.kernel), cost))).mean()
        for cost in (price, 30 * price)
    ]
    assert lengths[1] < 0.9 * lengths[0]


def test_noise_raises_the_price(shaken) -> None:
    noise = np.random.default_rng(0).normal(0, 0.02, shaken.grey.shape).astype(np.float32)
    prices = [gradient_price(cut(grey, shaken)) for grey in (shaken.grey, shaken.grey + noise)]
    assert prices[1] > 2 * prices[0]


def test_tiles_return_to_the_tones_of_the_photo(shaken) -> None:
    tiles = cut(shaken.grey, shaken)
    shown = np.sqrt(np.clip(shaken.grey, 0, 1))
    other = tiles.in_other_tones(Scale(shown, shaken.camera, None, 3.0))
    for one, picture in ((tiles, shaken.grey), (other, shown)):
        inner = slice(one.first, one.first + SIZE)
        pieces = [picture[y : y + SIZE, x : x + SIZE] for y, x in CORNERS]
        np.testing.assert_allclose(one.toned(one.g)[:, inner, inner], pieces, atol=1e-6)
    assert other.far == tiles.far
    part = tiles.some(slice(1, 2))
    np.testing.assert_array_equal(part.toned(part.g), tiles.toned(tiles.g)[1:])
    assert tiles.noise == pytest.approx(2 * cut(shaken.grey / 2, shaken).noise, rel=0.01)
