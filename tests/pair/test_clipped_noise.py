from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.pair.clipped_noise import unclipped_mean

SIGMA = 0.05


def scene():
    """Greys from black to white in broad steps."""
    return np.repeat(np.linspace(0, 1, 12), 40)[None] * np.ones((200, 1))


@pytest.mark.parametrize("channels", [(), (3,)])
def test_means_come_out_as_without_clipping(channels):
    rng = np.random.default_rng(1)
    light = scene()[..., None] * np.ones(channels or 1)
    light = light if channels else light[..., 0]
    noise = rng.normal(0, SIGMA, light.shape)
    photo = np.clip(light + noise, 0, 1).astype(np.float32)
    corrected = unclipped_mean(photo)
    for step in range(12):
        part = np.s_[20:-20, 40 * step + 12 : 40 * step + 28]
        before = abs(float(photo[part].mean() - light[part].mean()))
        after = abs(float(corrected[part].mean() - light[part].mean()))
        assert after < max(0.2 * before, 0.004)
    assert abs(photo[:, :20].mean()) > 0.015  # there was something to do


def test_a_photo_that_is_nowhere_clipped_is_unchanged():
    photo = np.random.default_rng(2).uniform(0.2, 0.8, (60, 70, 3)).astype(np.float32)
    np.testing.assert_array_equal(unclipped_mean(photo), photo)


def test_light_below_0_and_beyond_1_was_not_clipped():
    photo = np.random.default_rng(3).normal(0.5, 0.3, (80, 90)).astype(np.float32)
    np.testing.assert_array_equal(unclipped_mean(photo), photo)


def test_black_and_white_without_noise_stay():
    photo = np.zeros((80, 90), np.float32)
    photo[:40] = 1
    np.testing.assert_allclose(unclipped_mean(photo), photo, atol=0.03)


def test_lamps_get_no_halo():
    photo = np.full((120, 120), 0.1, np.float32)
    for x in range(20, 120, 25):
        for y in range(20, 120, 25):
            cv2.circle(photo, (x, y), 4, 1.0, -1)
    corrected = unclipped_mean(photo)
    dark = photo < 0.5
    np.testing.assert_allclose(corrected[dark], photo[dark], atol=1e-6)


def test_the_photo_is_left_alone():
    photo = np.random.default_rng(3).normal(0, 0.1, (50, 50)).clip(0, 1).astype(np.float32)
    before = photo.copy()
    unclipped_mean(photo)
    np.testing.assert_array_equal(photo, before)


def test_bands_do_not_show(monkeypatch):
    photo = np.random.default_rng(4).normal(0.02, 0.05, (90, 70)).clip(0, 1).astype(np.float32)
    whole = unclipped_mean(photo)
    monkeypatch.setattr("deshake.pair.clipped_noise._BAND", 16)
    np.testing.assert_allclose(unclipped_mean(photo), whole, atol=2e-3)
