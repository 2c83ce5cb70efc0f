from __future__ import annotations

import numpy as np
import pytest

from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.pair.small_pair import possible_turns, reduce_pair


@pytest.mark.parametrize(
    ("other", "turns"),
    [
        ((3000, 4000), [0]),
        ((1500, 2000), [0]),
        ((1499, 2000), [0]),
        ((4000, 3000), [1, 3]),
        ((1600, 1200), [1, 3]),
    ],
)
def test_turns_that_fit(other, turns):
    assert possible_turns((3000, 4000), other) == turns


def test_a_square_may_be_turned_or_not():
    assert possible_turns((500, 500), (250, 250)) == [0, 1, 3]


def test_other_proportions_are_refused():
    with pytest.raises(EstimationError, match="4000 x 3000 and 4000 x 2250 pixels"):
        possible_turns((3000, 4000), (2250, 4000))


def test_both_become_one_size_with_its_camera():
    rng = np.random.default_rng(0)
    f = rng.random((300, 400, 3), np.float32) * 0.5
    g = np.ascontiguousarray(np.rot90(f, -1))[::2, ::2]  # 400 x 300, smaller
    pair = reduce_pair(g, f, Camera.from_focal(500, 200, 150), 3)
    assert pair.g.shape == pair.f.shape == pair.camera.shape == (128, 96)
    assert pair.camera.focal_px == pytest.approx(500 * 128 / 200)
    assert np.corrcoef(pair.g.ravel(), pair.f.ravel())[0, 1] > 0.4
    assert pair.usable.all()


def test_clipped_pixels_are_marked():
    g = np.full((128, 128, 3), 0.5, np.float32)
    f = g[..., 0].copy()
    g[10, 20, 1] = 1
    f[30, 40] = 1
    pair = reduce_pair(g, f, Camera.from_focal(100, 128, 128), 0)
    assert sorted(map(tuple, np.argwhere(~pair.usable))) == [(10, 20), (30, 40)]
    assert pair.g[10, 20] == pytest.approx((0.5 + 1 + 0.5) / 3)


@pytest.mark.parametrize("shape", [(20, 30), (31, 400), (40, 4000)])
def test_slivers_are_refused(shape):
    image = np.zeros(shape, np.float32)
    with pytest.raises(EstimationError, match="too small or too narrow"):
        reduce_pair(image, image, Camera.from_focal(max(shape), *shape), 0)


def test_a_panorama_keeps_enough_rows():
    image = np.zeros((400, 3000), np.float32)
    pair = reduce_pair(image, image, Camera.from_focal(3000, 400, 3000), 0)
    assert pair.g.shape == (32, 240)
