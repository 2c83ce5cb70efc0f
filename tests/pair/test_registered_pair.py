from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.geometry.camera import Camera
from deshake.geometry.rotations import grid_steps
from deshake.metadata.metadata import Metadata
from deshake.pair.registered_pair import RegisteredPair
from deshake.pair.registration import Registration, registered

SHAPE = (120, 160)
CAMERA = Camera.from_focal(180.0, *SHAPE)
REGISTRATION = Registration(np.array([3, -4, 2]) * grid_steps(CAMERA), 5.0, 1.0, CAMERA)
SIGMA = 0.004


def photo(pixels):
    pixels = pixels.astype(np.float32)
    return Photo(
        pixels=pixels,
        clipped=np.zeros(pixels.shape[:2], bool),
        alpha=None,
        encoding=Encoding("TIFF", depth=16, grey=pixels.ndim == 2),
        metadata=Metadata(),
        source=Path("photo.tif"),
    )


def scene(shape=SHAPE):
    """A picture of smooth patches, 0.05 to 0.2."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return 0.125 + 0.075 * np.sign(np.sin(x / 11) * np.sin(y / 13))


def registered_pair(blurred, noisy):
    one, other = photo(blurred), photo(noisy)
    return RegisteredPair(one, other, REGISTRATION, *registered(other.pixels, REGISTRATION))


@pytest.mark.parametrize("channels", [1, 3])
def test_noise_is_as_strong_as_the_photo_s(channels):
    """Registered noise has the spread that registered white noise of that strength has."""
    rng = np.random.default_rng(5)
    shape = SHAPE if channels == 1 else (*SHAPE, channels)
    sharp = scene() if channels == 1 else np.repeat(scene()[..., None], channels, 2)
    pair = registered_pair(5 * sharp, sharp + SIGMA * rng.normal(size=shape))
    one, two = pair.noise()
    assert one.shape == SHAPE
    white = rng.normal(0, SIGMA / np.sqrt(channels), SHAPE).astype(np.float32)
    expected, _ = registered(white, REGISTRATION)
    assert one.std() == pytest.approx(expected.std(), rel=0.35)
    assert abs(np.corrcoef(one.ravel(), two.ravel())[0, 1]) < 0.05
    assert abs(one.mean()) < 0.1 * one.std()


def test_tones_are_taken_to_those_of_the_blurred_photo():
    rng = np.random.default_rng(1)
    ramp = np.linspace(0.05, 0.3, SHAPE[1]) * np.ones((*SHAPE[:1], 1))
    noisy = np.repeat(ramp[..., None], 3, 2) + SIGMA * rng.normal(size=(*SHAPE, 3))
    known, _ = registered(np.repeat(ramp[..., None], 3, 2).astype(np.float32), REGISTRATION)
    power = np.array([0.7, 1.0, 1.3])
    pair = registered_pair(2 * known**power, noisy)
    matched = pair.on_curves()
    inside = np.s_[20:-20, 20:-20]
    wrong = (matched.f_reg - pair.blurred.pixels)[inside]
    assert np.abs(wrong.mean((0, 1))).max() < 0.01
    slopes = (2 * power * known ** (power - 1))[inside]
    np.testing.assert_allclose(matched.slopes[inside].mean((0, 1)), slopes.mean((0, 1)), rtol=0.15)
    plain, curved = next(pair.noise()), next(matched.noise())
    assert curved.shape == SHAPE
    spread = np.sqrt((matched.shares() ** 2) @ (slopes**2).mean((0, 1)))
    assert curved[inside].std() == pytest.approx(
        plain[inside].std() / np.sqrt(pair.shares() @ pair.shares()) * spread, rel=0.3
    )


def test_a_noisy_channel_counts_less():
    rng = np.random.default_rng(2)
    sharp = np.repeat(scene()[..., None], 3, 2)
    sigmas = np.array([SIGMA, SIGMA, 6 * SIGMA])
    pair = registered_pair(5 * sharp, sharp + sigmas * rng.normal(size=(*SHAPE, 3)))
    shares = pair.shares()
    assert shares.sum() == pytest.approx(1)
    assert shares[2] < 0.1 * shares[:2].min()


def test_grey_and_colour_make_a_pair():
    sharp = scene()
    pair = registered_pair(np.repeat(5 * sharp[..., None], 3, 2), sharp)
    matched = pair.on_curves()
    assert matched.f_reg.shape == SHAPE
    assert next(matched.noise()).shape == SHAPE
