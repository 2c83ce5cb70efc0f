from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deshake.api.pictures_in import as_photo
from deshake.formats.photo import read_photo
from deshake.stages.reducing import reduced, within_white


@pytest.fixture
def photo(make_codes, save):
    return read_photo(save("a.png", make_codes(60, 90, 4)))


def opaque(photo):
    return replace(photo, alpha=None)


def blocks(values, side=3):
    height, width = values.shape[:2]
    return values.reshape(height // side, side, width // side, side, -1).astype(np.float64)


def test_a_new_pixel_is_the_mean_of_its_light(photo):
    small = reduced(opaque(photo), 30)
    assert small.shape == (20, 30)
    assert small.pixels == pytest.approx(blocks(photo.pixels).mean((1, 3)), abs=1e-6)
    assert np.array_equal(small.clipped, blocks(photo.clipped).max((1, 3))[..., 0] > 0)
    assert small.frame is None


def test_transparent_pixels_count_as_little_as_they_show(photo):
    small, weight = reduced(photo, 30), blocks(photo.alpha)
    mean = (blocks(photo.pixels) * weight).sum((1, 3)) / weight.sum((1, 3))
    assert small.pixels == pytest.approx(mean, abs=1e-6)
    assert np.abs(small.alpha - blocks(photo.alpha).mean((1, 3))[..., 0]).max() <= 0.51
    assert small.alpha.dtype == np.uint8
    hidden = np.zeros_like(photo.alpha)
    hidden[:, 45:] = 255
    half = reduced(replace(photo, alpha=hidden), 30)
    assert half.pixels == pytest.approx(reduced(opaque(photo), 30).pixels, abs=1e-6)
    premultiplied = replace(photo, encoding=replace(photo.encoding, premultiplied=True))
    assert reduced(premultiplied, 30).pixels == pytest.approx(
        blocks(photo.pixels).mean((1, 3)), abs=1e-6
    )


def test_grey_with_opacity(photo):
    grey = replace(photo, pixels=photo.pixels[..., 0].copy())
    weight = blocks(photo.alpha)
    mean = (blocks(grey.pixels) * weight).sum((1, 3)) / weight.sum((1, 3))
    assert reduced(grey, 30).pixels == pytest.approx(mean[..., 0], abs=1e-6)


def test_no_photo_is_enlarged(photo):
    assert reduced(photo, 90) is photo
    assert reduced(photo, 1000) is photo
    assert reduced(photo, 1).shape == (1, 1)


def test_fine_patterns_become_grey_and_not_coarse():
    """A pattern of 2.5 pixels cannot be shown at a third of the size: most of it must vanish."""
    x = np.arange(300, dtype=np.float32)
    wave = 0.5 + 0.5 * np.cos(2 * np.pi * x / 2.5)
    whole = as_photo(np.tile(wave, (300, 1)))
    assert np.ptp(reduced(whole, 100).pixels) < 0.35 * np.ptp(wave)
    assert np.ptp(wave[::3]) > 0.9 * np.ptp(wave)


def test_light_beyond_white_is_cut_off_in_the_colours_of_the_file(photo):
    bright = photo.with_pixels(2 * photo.pixels - 0.1)
    assert np.array_equal(within_white(bright).pixels, np.clip(bright.pixels, 0, 1))
    matrix = ((0.0, 1.0, 0.0), (0.0, 0.0, 2.0), (1.0, 0.0, -1.0))
    raw = replace(bright, encoding=replace(bright.encoding, matrix=matrix))
    cut = within_white(raw)
    r, g, b = np.moveaxis(bright.pixels, -1, 0)
    assert cut.pixels == pytest.approx(np.clip(np.stack([g, 2 * b, r - b], -1), 0, 1), abs=1e-6)
    assert cut.encoding.matrix is None
