from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.estimation.sharpness import looks_sharp, looks_soft, sharpness

PHOTOS = {"coffee": data.coffee, "motorcycle": lambda: data.stereo_motorcycle()[0]}


@pytest.fixture(scope="module", params=PHOTOS)
def photo(request) -> np.ndarray:
    """A sharp photo in linear light, 480 px wide."""
    grey = PHOTOS[request.param]() @ np.array([0.3, 0.59, 0.11]) / 255
    size = 480, round(480 * grey.shape[0] / grey.shape[1])
    return (cv2.resize(grey, size, interpolation=cv2.INTER_AREA) ** 2.2).astype(np.float32)


def test_sharp_photos_look_sharp_and_blurred_ones_do_not(photo: np.ndarray) -> None:
    assert looks_sharp(photo)
    for width in (6, 10, 16):
        assert not looks_sharp(cv2.blur(photo, (width, 1)))
        assert not looks_sharp(cv2.blur(photo, (1, width)))
        assert not looks_sharp(cv2.filter2D(photo, -1, np.eye(width, dtype=np.float32) / width))


def test_the_wider_the_blur_the_less_sharp(photo: np.ndarray) -> None:
    measured = [sharpness(cv2.GaussianBlur(photo, (0, 0), sigma)) for sigma in (0.5, 1, 2, 4)]
    assert measured == sorted(measured, reverse=True)
    assert measured[-1] == pytest.approx(0.5, abs=0.06)


def test_exposure_and_a_little_noise_count_little(photo: np.ndarray) -> None:
    noise = np.random.default_rng(0).normal(0, 0.003, photo.shape).astype(np.float32)
    assert sharpness(photo * np.float32(0.4)) == pytest.approx(sharpness(photo), rel=0.01)
    assert not looks_sharp(cv2.GaussianBlur(photo, (0, 0), 3) + noise)


def test_what_is_flat_is_not_sharp() -> None:
    assert sharpness(np.full((60, 80), 0.3, np.float32)) == 0


def test_what_is_a_little_soft_was_not_shaken(photo: np.ndarray) -> None:
    hardly, slightly = cv2.blur(photo, (2, 1)), cv2.blur(photo, (3, 1))
    assert not looks_sharp(hardly, collapsed=0)
    assert looks_soft(hardly, 1.6)
    assert not looks_soft(hardly, 1.8)  # so wide a blur is no softness
    assert looks_soft(slightly, 1.1)
    assert not looks_soft(slightly, 1.6)
    assert not looks_soft(cv2.blur(photo, (6, 1)), 1.1)
