from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.formats.transfer import Srgb
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.operators.shake_blur import ShakeBlur
from deshake.pair.camera_tones import blurred_planes, fitted_factor, needs_curves, with_tones_of
from deshake.pair.registration import Registration
from deshake.run import Run

HEIGHT, WIDTH = 120, 160
CAMERA = Camera.from_focal(200, HEIGHT, WIDTH)
STILL = Registration(np.zeros(3), 1.0, 1.0, CAMERA)
EVERYWHERE = np.ones((HEIGHT, WIDTH), bool)


def shown(light):
    return Srgb().from_linear(np.clip(light, 0, 1)).astype(np.float32)


def light_of(tone):
    return Srgb().to_linear(np.clip(tone, 0, 1)).astype(np.float32)


def psnr(a, b):
    return float(-10 * np.log10(np.mean(np.square(shown(a) - shown(b)))))


@pytest.fixture(scope="module")
def pair():
    """The blur, the sharp photo, the blurred one, and a short exposure before its camera."""
    rng = np.random.default_rng(5)
    sharp = np.full((HEIGHT, WIDTH, 3), 0.3, np.float32)
    for _ in range(150):
        place = tuple(int(rng.integers(side)) for side in sharp.shape[1::-1])
        colour = rng.uniform(0.02, 0.7, 3).tolist()
        cv2.circle(sharp, place, int(rng.integers(3, 16)), colour, -1, cv2.LINE_AA)
    path = [(-0.012, -0.01, -0.01), (0.012, 0.01, 0.012)]
    blur = ShakeBlur(RotationKernel.from_path(path, CAMERA).centred())
    g = np.moveaxis(blurred_planes(np.moveaxis(sharp, -1, 0), blur), 0, -1)
    noisy = sharp + rng.normal(0, 0.02, sharp.shape)
    return blur, sharp, g.astype(np.float32), noisy.astype(np.float32)


def developed(light):
    """Return the light of a file of the camera: a dark S of its own for each channel."""
    tone = shown(light * np.array([0.5, 0.6, 0.45], np.float32))
    return light_of(0.6 * tone + 0.4 * tone * tone * (3 - 2 * tone))


def test_curves_are_needed_only_where_a_factor_does_not_fit(pair):
    blur, _, g, noisy = pair
    for f, curved in ((noisy, False), (3 * developed(noisy), True)):
        Af = blurred_planes(np.moveaxis(f, -1, 0), blur)
        assert needs_curves(g, Af, EVERYWHERE) == curved


def test_the_tones_and_the_noise_become_those_of_the_blurred_photo(pair):
    blur, sharp, g, noisy = pair
    f_N = developed(noisy)
    photo = with_tones_of(g, f_N, STILL, blur, EVERYWHERE)
    pixels, denoised = (np.moveaxis(a, 0, -1) for a in (photo.pixels, photo.denoised))
    factor = f_N * (g.mean() / f_N.mean())
    assert psnr(denoised, sharp) > psnr(factor, sharp) + 6
    assert psnr(denoised, sharp) > psnr(pixels, sharp) + 2
    np.testing.assert_allclose(pixels.mean((0, 1)), sharp.mean((0, 1)), rtol=0.03)
    deviation = np.sqrt(photo.variance().mean())
    assert 0.02 < deviation < 0.06  # more than there is: a camera leaves most of it near edges


def test_wrong_colours_become_those_of_the_blurred_photo(pair):
    blur, sharp, g, noisy = pair
    f_N = developed(noisy)
    f_N[..., 0] = cv2.GaussianBlur(f_N[::-1, ::-1, 0], (0, 0), 8)
    photo = with_tones_of(g, f_N, STILL, blur, EVERYWHERE)

    def coarse(planes):
        return cv2.GaussianBlur(planes, (0, 0), 12)

    red = coarse(photo.denoised[0]) - coarse(np.ascontiguousarray(sharp[..., 0]))
    lost = coarse(np.ascontiguousarray(sharp[..., 0]))
    assert np.sqrt(np.mean(np.square(red))) < 0.35 * lost.std()


def test_a_grey_pair_passes_and_threads_do_not_change_a_byte(pair):
    blur, _, g, noisy = pair
    grey, dark = (np.ascontiguousarray(a[..., 1]) for a in (g, developed(noisy)))
    photos = [with_tones_of(grey, dark, STILL, blur, EVERYWHERE, run=Run(n)) for n in (1, 3)]
    assert photos[0].pixels.shape == (1, HEIGHT, WIDTH)
    assert photos[0].denoised.tobytes() == photos[1].denoised.tobytes()


@pytest.mark.parametrize(("factor", "expected"), [(1.1, 1.1), (0.9, 0.9), (2.0, 1.25), (0.1, 0.8)])
def test_the_factor_is_fitted_where_both_are_usable(factor, expected):
    camera = Camera.from_focal(100.0, 40, 50)
    blur = ShakeBlur(RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera))
    light = np.random.default_rng(0).random((40, 50)).astype(np.float32)
    usable = np.ones((40, 50), bool)
    usable[10:14, 20:24] = False
    g = factor * light
    g[10:14, 20:24] = 50
    assert fitted_factor(g, light[None], usable, blur) == pytest.approx(expected, rel=1e-5)
