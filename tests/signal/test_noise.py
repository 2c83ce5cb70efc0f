from __future__ import annotations

import io

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy.optimize import nnls
from skimage import data

from deshake.signal.noise import (
    averaged_over_blur,
    coarse_noise,
    noise_level,
    noise_line,
    noise_model,
    pair_means,
    smoothed,
    tone_noise,
)


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
    estimates = [coarse_noise((photo + s * noise).astype("f4")) for s in (0, 0.01, 0.02, 0.04)]
    assert estimates == sorted(estimates)
    assert estimates[0] < 1e-5


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


@pytest.mark.parametrize("photons", [300, 3000])
@pytest.mark.parametrize("compressed", [False, True])
def test_the_model_follows_the_light(photo, photons, compressed):
    rng = np.random.default_rng(5)
    g = np.clip(rng.poisson(photo * photons) / photons, 0, 1).astype(np.float32)
    slope, floor = noise_model(jpeg(g) if compressed else g)
    assert (0.2 if compressed else 0.4) / photons < slope < 2 / photons
    assert 0 < floor < 0.1 / photons


def test_the_model_of_even_noise_is_flat():
    rng = np.random.default_rng(6)
    ramp = np.linspace(0.1, 0.9, 400)
    slope, floor = noise_model((ramp + rng.normal(0, 0.02, (320, 400))).astype(np.float32))
    assert floor == pytest.approx(0.02**2, rel=0.6)
    assert slope < 0.3 * floor


def test_the_model_of_a_photo_too_small_or_even_is_hardly_any():
    for g in (np.ones((3, 4), np.float32), np.full((60, 60), 0.3, np.float32)):
        slope, floor = noise_model(g)
        assert slope == pytest.approx(0, abs=1e-6)
        assert 0 < floor < 1e-6


def test_smoothing_is_a_tent():
    point = np.zeros((21, 21), np.float32)
    point[10, 10] = 1
    tent = smoothed(point, 3)
    assert tent.sum() == pytest.approx(1, rel=1e-5)
    np.testing.assert_allclose(
        tent[10, 10::2], [1 / 49, 5 / 343, 3 / 343, 1 / 343, 0, 0], atol=1e-6
    )
    np.testing.assert_allclose(smoothed(point + 2, 3) - tent, 2, rtol=1e-5)


@pytest.mark.parametrize("shape", [(9, 14), (3, 2)])
def test_beyond_the_border_smoothing_sees_the_nearest_pixel(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).random(shape).astype(np.float32)
    wide = smoothed(np.pad(image, 20, mode="edge"), 4)[20:-20, 20:-20]
    once = smoothed(image, 4)
    inner = np.s_[4:-4, 4:-4]  # the second pass extends what the first one made
    np.testing.assert_allclose(once[inner], wide[inner], rtol=1e-5)
    assert image.min() <= once.min() <= once.max() <= image.max()


@pytest.mark.parametrize(("margin", "reach"), [(9, 8), (2, 2), (0, 2)])
def test_an_average_reaches_as_far_as_the_blur(margin: int, reach: int) -> None:
    point = np.zeros((31, 31), np.float32)
    point[15, 15] = 1
    seen = np.flatnonzero(averaged_over_blur(point, margin)[15] > 1e-6)
    np.testing.assert_array_equal(seen, np.arange(15 - reach, 16 + reach))


def white(shape: tuple[int, int], sigma: float) -> np.ndarray:
    return np.random.default_rng(0).normal(scale=sigma, size=shape).astype(np.float32)


@pytest.mark.parametrize("sigma", [0.002, 0.02, 0.2])
def test_white_noise_is_measured(sigma) -> None:
    assert noise_level(white((200, 260), sigma)) == pytest.approx(sigma, rel=0.02)


def test_noise_is_distinguished_from_edges(sharp) -> None:
    soft = cv2.GaussianBlur(sharp, (0, 0), 2.0)
    assert noise_level(soft + white(sharp.shape, 0.02)) == pytest.approx(0.02, rel=0.1)
    assert noise_level(soft) < 0.002


def test_planes_and_steps_are_no_noise() -> None:
    y, x = np.mgrid[:60, :80].astype(np.float32)
    assert noise_level(0.25 * x - 0.5 * y) < 1e-5
    assert noise_level((x > 40).astype(np.float32)) < 1e-5


def test_a_part_of_a_large_picture_gives_its_noise() -> None:
    assert noise_level(white((1100, 900), 0.05)) == pytest.approx(0.05, rel=0.02)
    assert noise_level(white((4, 300_000), 0.05)) == pytest.approx(0.05, rel=0.02)
    assert noise_level(white((300_000, 4), 0.05)) == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize("shape", [(200, 260), (1100, 900)])
def test_the_noise_level_in_other_tones_is_that_of_their_picture(shape) -> None:
    light = np.square(white(shape, 0.05) + np.float32(0.5))
    assert noise_level(light, tones=np.sqrt) == noise_level(np.sqrt(light))
    assert noise_level(light, tones=np.sqrt) == pytest.approx(0.05, rel=0.02)


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


def test_noise_of_tones_is_seen_after_denoising() -> None:
    noise = np.random.default_rng(0).normal(0, 0.05, (200, 300)).astype(np.float32)
    assert tone_noise(0.5 + noise) == pytest.approx(0.05, rel=0.1)
    coarse = cv2.GaussianBlur(noise, (0, 0), 1.2)  # as a camera leaves it
    finest = np.diff(np.diff(coarse, axis=0), axis=1) / 2
    assert tone_noise(0.5 + coarse) > 2 * finest.std()
    assert tone_noise(np.full((20, 30), 0.5, np.float32)) == pytest.approx(0.004)


def test_the_line_is_that_of_scipys_least_squares_without_negative_factors():
    rng = np.random.default_rng(4)
    signs = set()
    for _ in range(200):
        levels = np.sort(rng.random(8))
        variances = np.abs(rng.normal(0, 1) * levels + rng.normal(0, 1)) * rng.random(8) + 1e-3
        design = np.stack([levels, np.ones(8)], 1) / variances[:, None]
        slope, floor = nnls(design, np.ones(8))[0]
        assert noise_line(levels, variances, 1e-9) == pytest.approx((slope, max(floor, 1e-9)))
        signs.add((slope > 0, floor > 0))
    assert signs == {(True, True), (True, False), (False, True)}
