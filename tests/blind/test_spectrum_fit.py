from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.blind.spectrum_fit import DirectedBlur, directed_blur
from deshake.geometry.camera import Camera
from deshake.signal.pyramid import Pyramid


def of(grey: np.ndarray) -> Pyramid:
    grey = grey + 0.003 * np.random.default_rng(0).normal(size=grey.shape)
    return Pyramid(grey.astype(np.float32), Camera.from_focal(600.0, *grey.shape))


@pytest.fixture(scope="module")
def photo() -> np.ndarray:
    """A photo in linear light with texture in all directions, 512 px."""
    return ((data.astronaut() @ np.array([0.3, 0.59, 0.11]) / 255) ** 2.2).astype(np.float32)


def line(length: int, angle: float) -> np.ndarray:
    """Draw the kernel of an even motion, y down."""
    side = length + 4
    place = np.linspace(-length / 2, length / 2, 20 * length)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    x, y = side / 2 + place * c, side / 2 + place * s
    drawn, _, _ = np.histogram2d(y, x, bins=side, range=[[0, side], [0, side]])
    return (drawn / drawn.sum()).astype(np.float32)


@pytest.mark.parametrize("angle", [0, 30, 90, 140])
@pytest.mark.parametrize("length", [6, 12])
def test_measures_direction_and_width_of_a_motion(photo, length, angle) -> None:
    blur = directed_blur(of(cv2.filter2D(photo, -1, line(length, angle))))
    assert blur.strength > 0.3
    turn = abs(blur.direction - angle) % 180
    assert min(turn, 180 - turn) < 20
    assert blur.sigma_px * 12**0.5 == pytest.approx(length, rel=0.6)


def test_a_round_blur_has_less_strength_than_a_motion(photo) -> None:
    shaken = directed_blur(of(cv2.filter2D(photo, -1, line(8, 20))))
    for sigma in (1, 2.5):
        assert directed_blur(of(cv2.GaussianBlur(photo, (0, 0), sigma))).strength < 0.2
    assert shaken.strength > 0.4


def test_a_photo_smaller_than_a_tile_shows_nothing(photo) -> None:
    blur = directed_blur(of(photo[100:150, 100:160]))
    assert blur.strength == 0
    assert not blur.certain


def test_a_fit_is_certain_if_a_scale_has_enough_tiles(photo) -> None:
    assert directed_blur(of(photo)).certain
    assert not directed_blur(of(photo[100:180, 100:200])).certain


def test_clipped_tiles_do_not_count(photo) -> None:
    camera = Camera.from_focal(600.0, *photo.shape)
    pyramid = Pyramid(photo, camera, np.ones(photo.shape, bool))
    assert directed_blur(pyramid) == DirectedBlur(0.0, 0.0, 0.0, certain=False)
