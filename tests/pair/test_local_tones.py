from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.pair.local_tones import local_tones, local_trust, wrong_colours

SHAPE = (150, 200)
EVERYWHERE = np.ones(SHAPE, bool)
REACH = 10


@pytest.fixture(scope="module")
def light():
    """Smooth patches in three colours, (3, h, w), as blurred light is."""
    rng = np.random.default_rng(3)
    planes = [cv2.GaussianBlur(rng.random(SHAPE), (0, 0), 3) for _ in range(3)]
    return np.stack([0.3 + 4 * (plane - 0.5) * 0.3 for plane in planes]).astype(np.float32)


def test_gains_and_offsets_that_change_slowly_are_fitted(light):
    across = np.linspace(0, 1, SHAPE[1], dtype=np.float32)
    gain, offset = 0.7 + 0.6 * across, 0.1 * across
    g = np.moveaxis(gain * light + offset, 0, -1)
    tones = local_tones(g, light, EVERYWHERE, REACH)
    left = tones(light) - np.moveaxis(g, -1, 0)
    assert np.abs(left).max() < 0.1 * np.abs(light - np.moveaxis(g, -1, 0)).max()


def test_where_nothing_is_shown_the_gain_is_one():
    flat = np.full((1, *SHAPE), 0.2, np.float32)
    noise = np.random.default_rng(1).normal(0, 0.002, SHAPE).astype(np.float32)
    tones = local_tones(np.full(SHAPE, 0.3, np.float32) + noise, flat, EVERYWHERE, REACH)
    np.testing.assert_allclose(tones.gain, 1, atol=0.02)
    np.testing.assert_allclose(tones(flat), 0.3, atol=0.01)


def test_clipped_pixels_do_not_count(light):
    g = np.moveaxis(light, 0, -1).copy()
    mask = EVERYWHERE.copy()
    mask[60:80, 90:110] = False
    g[~mask] = 1
    np.testing.assert_allclose(local_tones(g, light, mask, REACH).gain, 1, atol=0.02)


def test_detail_that_the_noisy_photo_lost_is_not_taken_from_it(light):
    g = np.moveaxis(light, 0, -1)
    crushed = light.copy()
    crushed[:, :, 120:] = 0.3
    trust = local_trust(g, crushed, EVERYWHERE, REACH)
    assert trust[:, :80].min() > 0.95
    assert np.median(trust[:, 150:]) < 0.1


def test_wrong_colours_are_distinguished_from_wrong_lightness(light):
    g = np.moveaxis(light, 0, -1)
    assert wrong_colours(g, 0.8 * light, EVERYWHERE, REACH) < 0.2
    assert wrong_colours(g, np.repeat(light[:1], 3, 0), EVERYWHERE, REACH) > 0.5
    assert wrong_colours(g[..., 0], light[:1], EVERYWHERE, REACH) == 0
