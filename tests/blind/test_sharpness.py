from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from deshake.blind.sharpness import looks_sharp, sharpness
from deshake.geometry.camera import Camera
from deshake.signal.pyramid import Pyramid

PHOTOS = {"coffee": data.coffee, "motorcycle": lambda: data.stereo_motorcycle()[0]}


def of(grey: np.ndarray, clipped: np.ndarray | None = None) -> Pyramid:
    return Pyramid(grey.astype(np.float32), Camera.from_focal(400.0, *grey.shape), clipped)


@pytest.fixture(scope="module", params=PHOTOS)
def photo(request) -> np.ndarray:
    """A sharp photo in linear light, 300 px wide."""
    grey = PHOTOS[request.param]() @ np.array([0.3, 0.59, 0.11]) / 255
    size = 300, round(300 * grey.shape[0] / grey.shape[1])
    return (cv2.resize(grey, size, interpolation=cv2.INTER_AREA) ** 2.2).astype(np.float32)


def test_sharp_photos_look_sharp_and_blurred_ones_do_not(photo) -> None:
    assert looks_sharp(of(photo))
    for width in (4, 8, 16):
        assert not looks_sharp(of(cv2.blur(photo, (width, 1))))
        assert not looks_sharp(of(cv2.blur(photo, (1, width))))
        aslant = np.eye(width, dtype=np.float32) / width
        assert not looks_sharp(of(cv2.filter2D(photo, -1, aslant)))
        assert not looks_sharp(of(cv2.filter2D(photo, -1, aslant[::-1].copy())))


def test_the_wider_the_blur_the_less_sharp(photo) -> None:
    measured = [
        sharpness(of(cv2.GaussianBlur(photo, (0, 0), sigma)), 0) for sigma in (0.5, 1, 2, 4)
    ]
    assert measured == sorted(measured, reverse=True)
    assert measured[-1] == pytest.approx(0.5, abs=0.06)


def test_a_blurred_photo_is_sharper_at_coarser_scales(photo) -> None:
    pyramid = of(cv2.GaussianBlur(photo, (0, 0), 1.5))
    measured = [sharpness(pyramid, level) for level in (0, 2, 4)]
    assert measured == sorted(measured)
    assert measured[-1] > measured[0] + 0.1


def test_exposure_and_a_little_noise_count_little(photo) -> None:
    noise = np.random.default_rng(0).normal(0, 0.003, photo.shape).astype(np.float32)
    assert sharpness(of(photo * np.float32(0.4)), 0) == pytest.approx(
        sharpness(of(photo), 0), rel=0.02
    )
    assert not looks_sharp(of(cv2.GaussianBlur(photo, (0, 0), 3) + noise))


def test_what_is_flat_in_some_direction_is_not_sharp() -> None:
    assert sharpness(of(np.tile(np.linspace(0, 1, 80) > 0.5, (60, 1))), 0) == 0
    noise = np.random.default_rng(0).normal(0.5, 0.03, (100, 120))
    assert not looks_sharp(of(noise))


def test_of_a_large_photo_the_tiles_in_focus_count() -> None:
    """A background out of focus is no shake; a shake spares no tile."""
    rng = np.random.default_rng(0)
    sharp = np.kron(rng.random((60, 80)), np.ones((10, 10))).astype(np.float32)
    sharp = cv2.GaussianBlur(sharp, (0, 0), 0.4)
    half = sharp.copy()
    half[:, 400:] = cv2.GaussianBlur(sharp, (0, 0), 4)[:, 400:]
    assert sharpness(of(half), 0) == pytest.approx(sharpness(of(sharp), 0), abs=0.05)
    shaken = of(cv2.blur(half, (9, 1)))
    assert sharpness(shaken, 0) < sharpness(of(half), 0) - 0.15
    assert not looks_sharp(shaken)


def test_the_smallest_photo_can_be_measured(photo) -> None:
    assert 0 <= sharpness(of(photo[60:108, 60:110]), 0) <= 1.5
