from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.signal.noise import noise_level


def white(shape: tuple[int, int], sigma: float) -> np.ndarray:
    return np.random.default_rng(0).normal(scale=sigma, size=shape).astype(np.float32)


@pytest.mark.parametrize("sigma", [0.002, 0.02, 0.2])
def test_white_noise_is_measured(sigma) -> None:
    assert noise_level(white((200, 260), sigma)) == pytest.approx(sigma, rel=0.02)


def test_noise_is_told_from_edges(sharp) -> None:
    soft = cv2.GaussianBlur(sharp, (0, 0), 2.0)
    assert noise_level(soft + white(sharp.shape, 0.02)) == pytest.approx(0.02, rel=0.1)
    assert noise_level(soft) < 0.002


def test_planes_and_steps_are_no_noise() -> None:
    y, x = np.mgrid[:60, :80].astype(np.float32)
    assert noise_level(0.25 * x - 0.5 * y) < 1e-5
    assert noise_level((x > 40).astype(np.float32)) < 1e-5


def test_of_a_large_picture_a_part_says_as_much() -> None:
    assert noise_level(white((1100, 900), 0.05)) == pytest.approx(0.05, rel=0.02)
    assert noise_level(white((4, 300_000), 0.05)) == pytest.approx(0.05, rel=0.02)
    assert noise_level(white((300_000, 4), 0.05)) == pytest.approx(0.05, rel=0.1)


def test_only_the_pixels_asked_for_count() -> None:
    picture = white((120, 160), 0.03)
    picture[:, :90] *= 10
    where = np.zeros(picture.shape, bool)
    where[:, 92:] = True
    assert noise_level(picture, where) == pytest.approx(0.03, rel=0.05)
    assert noise_level(picture) > 0.06


def test_noise_scales_with_the_picture(sharp) -> None:
    assert noise_level(4 * sharp) == pytest.approx(4 * noise_level(sharp), rel=1e-5)
    assert noise_level(sharp + 1) == pytest.approx(noise_level(sharp), rel=1e-3)
