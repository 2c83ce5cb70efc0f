from __future__ import annotations

import io

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from deshake.deconvolution.noise import coarse_noise, pair_means


def jpeg(image, quality=90):
    """Write an image, 0..1, as an 8-bit JPEG and read it back."""
    stream = io.BytesIO()
    Image.fromarray(np.rint(image * 255).astype(np.uint8)).save(stream, "JPEG", quality=quality)
    return np.asarray(Image.open(stream)).astype(np.float32) / 255


@pytest.fixture(scope="module")
def photo():
    """A real photo, blurred as shaken ones are."""
    image = data.coffee().astype(np.float32) / 255
    return cv2.GaussianBlur(image, (0, 0), 4)


@pytest.mark.parametrize("sigma", [0.005, 0.02, 0.08])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_finds_white_noise(sigma, channels):
    rng = np.random.default_rng(1)
    slope = np.linspace(0.2, 0.8, 320).reshape(320, 1, *[1 for _ in channels])
    g = (slope + rng.normal(0, sigma, (320, 400, *channels))).astype(np.float32)
    assert coarse_noise(g) == pytest.approx(sigma**2, rel=0.6)


@pytest.mark.parametrize("sigma", [0.01, 0.03])
def test_finds_the_noise_of_a_jpeg_photo(photo, sigma):
    rng = np.random.default_rng(2)
    g = jpeg(np.clip(photo + rng.normal(0, sigma, photo.shape), 0, 1))
    assert 0.25 * sigma**2 < coarse_noise(g) < 2 * sigma**2


def test_more_noise_is_more(photo):
    rng = np.random.default_rng(3)
    noise = rng.normal(0, 1, photo.shape)
    found = [coarse_noise((photo + s * noise).astype("f4")) for s in (0, 0.01, 0.02, 0.04)]
    assert found == sorted(found)
    assert found[0] < 1e-5


def test_slopes_and_even_areas_are_no_noise():
    x = np.linspace(0, 1, 200, dtype=np.float32)
    assert coarse_noise(np.full((100, 100), 0.4, np.float32)) == 0
    assert coarse_noise(x[:, None] * 0.3 + x * 0.7) < 1e-12


@pytest.mark.parametrize("shape", [(1, 1), (3, 500), (13, 40, 3)])
def test_photos_smaller_than_a_block_have_none(shape):
    assert coarse_noise(np.ones(shape, np.float32)) == 0


def test_pair_means():
    image = np.arange(15, dtype=np.float32).reshape(3, 5)
    np.testing.assert_array_equal(pair_means(image), [[3, 5]])
