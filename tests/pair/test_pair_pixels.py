from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.rotations import grid_steps
from deshake.pair.kernel_settings import SETTINGS
from deshake.pair.pair_pixels import (
    PairPictures,
    derivatives,
    drawn_pixels,
    noise_excess,
    usable_pixels,
)
from deshake.pair.pair_rows import ROW_BLOCK

SHAPE = (90, 120)
CAMERA = Camera.from_focal(130.0, *SHAPE)


def pictures(**changes):
    g = np.random.default_rng(0).random(SHAPE, np.float32) * 0.5
    case = {"g": g, "f_reg": g / 4, "valid": np.ones(SHAPE, bool), "noise": []} | changes
    return PairPictures.of(**case)


def test_grey_is_the_mean_whose_noise_is_the_least():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(*SHAPE, 3)).astype(np.float32)
    reduced = pictures(noise=iter([noise]))
    np.testing.assert_allclose(reduced.noise[0], noise.mean(-1), atol=1e-6)
    assert reduced.noise[0].std() == pytest.approx(3**-0.5, rel=0.03)


def test_large_photos_are_reduced():
    g = np.zeros((40, 3200), np.float32)
    reduced = PairPictures.of(g, g, np.ones(g.shape), [g])
    assert reduced.g.shape == reduced.f.shape == reduced.noise[0].shape == (20, 1600)
    half = reduced.at((10, 800))
    assert half.g.shape == half.known.shape == half.clipped.shape == (10, 800)


def test_any_clipped_colour_counts():
    g = np.full((*SHAPE, 3), 0.5, np.float32)
    g[30, 40, 1] = 1
    reduced = pictures(g=g)
    assert reduced.clipped[30, 40] == 1
    assert reduced.clipped.sum() == 1


def test_derivatives_are_linear_and_of_unit_slope():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    one, other = np.random.default_rng(1).random((2, *SHAPE), np.float32)
    across, down = derivatives(2 * x - 3 * y)[:, 5:-5, 5:-5]
    np.testing.assert_allclose(across, 2, atol=1e-3)
    np.testing.assert_allclose(down, -3, atol=1e-3)
    both = derivatives(3 * one - other)
    np.testing.assert_allclose(both, 3 * derivatives(one) - derivatives(other), atol=1e-5)


def test_usable_pixels_see_what_is_known():
    valid = np.ones(SHAPE, bool)
    valid[:, :20] = False
    g = np.full(SHAPE, 0.5, np.float32)
    g[50, 60] = 1
    theta = np.array([[0, 6, 0], [0, -6, 0], [2, 0, 0]]) * grid_steps(CAMERA)
    usable = usable_pixels(pictures(g=g, valid=valid), CAMERA, theta)
    assert not usable[:, :26].any()
    assert not usable[47:54, 57:64].any()
    assert usable[45, 60]
    assert not usable[:, -6:].any()
    assert not usable[:2].any()
    assert usable[12:40, 40:100].all()


def test_pixels_on_edges_are_drawn_the_more_often():
    image = np.zeros(SHAPE, np.float32)
    image[:, 60:] = 1
    image += 1e-3 * np.random.default_rng(0).random(SHAPE, np.float32)
    usable = np.ones(SHAPE, bool)
    usable[:, ::2] = False
    drawn = drawn_pixels(derivatives(image), usable, 1)
    both = np.concatenate(drawn)
    assert len(np.unique(both, axis=0)) == len(both)
    assert len(drawn.fitted) % ROW_BLOCK == len(drawn.held_out) % ROW_BLOCK == 0
    assert usable[both[:, 1], both[:, 0]].all()
    again = drawn_pixels(derivatives(image), usable, 1)
    np.testing.assert_array_equal(drawn.fitted, again.fitted)


def test_few_are_drawn_of_many(monkeypatch):
    few = replace(SETTINGS, pixels=4 * ROW_BLOCK, held_out=ROW_BLOCK)
    monkeypatch.setattr("deshake.pair.pair_pixels.SETTINGS", few)
    image = np.zeros(SHAPE, np.float32)
    image[:, 60:] = 1
    drawn = drawn_pixels(derivatives(image), np.ones(SHAPE, bool), 1)
    assert len(drawn.fitted) == 4 * ROW_BLOCK
    assert len(drawn.held_out) == ROW_BLOCK
    for places in drawn:  # all alike: 1 in 10 lies there
        assert np.mean(np.abs(places[:, 0] - 59.5) < 6) > 0.4


@pytest.mark.parametrize(
    ("image", "count", "what"),
    [
        (np.zeros(SHAPE, np.float32), 90 * 120, "no detail"),
        (np.random.default_rng(0).random(SHAPE, np.float32), 100, "too few pixels"),
        (np.random.default_rng(0).random(SHAPE, np.float32), 0, "too few pixels"),
    ],
)
def test_what_cannot_be_drawn_is_reported(image, count, what):
    usable = (np.arange(SHAPE[0] * SHAPE[1]) < count).reshape(SHAPE)
    with pytest.raises(EstimationError, match=what):
        drawn_pixels(derivatives(image), usable, 0)


def test_stronger_noise_is_measured_where_the_photo_is_flat():
    rng = np.random.default_rng(4)
    g = np.repeat(np.linspace(0.1, 0.8, 6), 20)[None] * np.ones((*SHAPE[:1], 1))
    drawn, true_noise = rng.normal(size=(2, *SHAPE))
    for strength, excess in ((1.0, 1.0), (2.0, 4.0), (0.5, 1.0)):
        noisy = g + 0.02 * strength * true_noise
        case = {"g": g, "f_reg": noisy, "noise": [0.02 * drawn]}
        ratio = noise_excess(pictures(**{k: to_floats(v) for k, v in case.items()}))
        assert ratio == pytest.approx(excess, rel=0.25)
    assert noise_excess(pictures()) == 1


def to_floats(images):
    if isinstance(images, list):
        return [image.astype(np.float32) for image in images]
    return images.astype(np.float32)
