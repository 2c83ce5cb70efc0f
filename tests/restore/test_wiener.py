from __future__ import annotations

import sys

import numpy as np
import pytest

from deshake.errors import DeshakeError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.operators.shake_blur import ShakeBlur
from deshake.restore.wiener import point_spread, unsupervised_wiener, wiener
from deshake.run import Run

METHODS = [wiener, unsupervised_wiener]


@pytest.fixture
def uniform(lab):
    return lab.kernels["uniform"]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("channels", [1, 3])
def test_recovers_a_uniform_blur(method, channels, lab, uniform):
    sharp = lab.scene()
    if channels == 3:
        sharp = sharp[..., None] * np.array([1, 0.8, 0.6], np.float32)
    g = lab.noisy(lab.shaken(uniform, sharp), 0.003)
    restored = method(g, uniform)
    assert lab.psnr(restored.pixels, lab.frame(sharp)) > lab.psnr(g, lab.frame(sharp)) + 1.5
    assert restored.pixels.shape == g.shape
    assert restored.pixels.dtype == np.float32
    assert restored.pixels.min() >= 0
    assert 0.5 * 0.003 < restored.residual < 0.02


@pytest.mark.parametrize("method", METHODS)
def test_the_kernel_need_not_be_centred(method, lab, uniform):
    g = lab.noisy(lab.shaken(uniform, lab.scene()), 0.003)
    f = method(g, uniform).pixels
    turned = method(g, uniform.shifted((4, -3, 0))).pixels
    assert np.sqrt(np.mean(np.square(turned - f))) < 0.02


def test_the_point_spread_blurs_as_the_operator_does(uniform):
    h = point_spread(uniform)
    assert h.sum() == pytest.approx(1, rel=1e-6)
    r = len(h) // 2
    blur = ShakeBlur(uniform, margin=r)
    point = np.zeros(blur.latent_shape, np.float32)
    point[60 + r, 80 + r] = 1
    spread_point = blur.forward(point)[60 - r : 61 + r, 80 - r : 81 + r]
    np.testing.assert_allclose(spread_point, h, atol=2e-3)
    assert np.abs(h - h[::-1, ::-1]).max() > 0.02  # its direction matters


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["pan", "roll", "all"])
def test_refuses_a_blur_that_varies(method, name, lab):
    g = np.full(lab.shape, 0.5, np.float32)
    with pytest.raises(DeshakeError, match="same blur all over") as caught:
        method(g, lab.kernels[name])
    assert "--method" in caught.value.hint


@pytest.mark.parametrize("method", METHODS)
def test_says_which_library_is_missing(method, lab, uniform, monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage.restoration", None)
    with pytest.raises(DeshakeError, match="need scikit-image") as caught:
        method(np.full(lab.shape, 0.5, np.float32), uniform)
    assert "deshake[wiener]" in caught.value.hint


@pytest.mark.parametrize("method", METHODS)
def test_borders_do_not_wrap_around(method, lab, uniform):
    g = np.full(lab.shape, 0.2, np.float32)
    g[:, 95:] = 0.8
    f = method(g, uniform).pixels
    assert np.abs(f[:, :8] - 0.2).max() < 0.06
    assert np.abs(f[:, -8:] - 0.8).max() < 0.05


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("level", [0.0, 0.4])
def test_a_constant_photo_stays_constant(method, level, lab, uniform):
    g = np.full((*lab.shape, 3), level, np.float32)
    np.testing.assert_allclose(method(g, uniform).pixels, level, atol=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_grey_photos_stay_grey(method, lab, uniform):
    g = lab.noisy(lab.shaken(uniform, lab.scene()), 0.003)
    colour = method(np.stack([g, g, g], -1), uniform).pixels
    np.testing.assert_allclose(colour, colour[..., :1].repeat(3, -1), atol=1e-6)


@pytest.mark.parametrize("sigma", [0.001, 0.01, 0.05])
def test_the_balance_follows_the_noise(sigma, lab, uniform):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(uniform, sharp), sigma)
    assert lab.psnr(wiener(g, uniform).pixels, lab.frame(sharp)) > lab.psnr(g, lab.frame(sharp)) + 1


def test_iterations(lab, uniform):
    g = lab.noisy(lab.shaken(uniform, lab.scene()), 0.01)
    for count in (1, 2, 20):
        few = unsupervised_wiener(g, uniform, iterations=count)
        assert few.iterations == count
        assert np.isfinite(few.pixels).all()
    assert unsupervised_wiener(g, uniform).iterations > 20
    with pytest.raises(ValueError, match="no iterations"):
        wiener(g, uniform, iterations=3)


@pytest.mark.parametrize("method", METHODS)
def test_clipped_pixels_do_not_count_as_residual(method, lab, uniform):
    g = lab.noisy(lab.shaken(uniform, lab.scene()), 0.003)
    broken = g.copy()
    broken[70:80, 70:80] = 1
    clipped = broken == 1
    all_of_it, but_these = (method(broken, uniform, clipped=c) for c in (None, clipped))
    assert but_these.residual < all_of_it.residual
    np.testing.assert_array_equal(but_these.pixels, all_of_it.pixels)


@pytest.mark.parametrize("method", METHODS)
def test_the_photo_is_left_alone_and_the_result_is_the_same_again(method, lab, uniform):
    g = lab.noisy(lab.shaken(uniform, lab.scene()), 0.003)
    before = g.copy()
    g.setflags(write=False)
    reports = []
    first = method(g, uniform, run=Run(1, lambda part, text: reports.append((part, text))))
    np.testing.assert_array_equal(g, before)
    assert first.pixels.tobytes() == method(g, uniform, run=Run(4)).pixels.tobytes()
    assert reports == [(1, "deblurring, colour 1")]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (7, 5)])
def test_the_smallest_photos_pass(method, shape):
    g = np.full(shape, 0.5, np.float32)
    kernel = RotationKernel.delta(Camera.from_focal(50, *shape))
    np.testing.assert_allclose(method(g, kernel).pixels, g, atol=0.02)


@pytest.mark.parametrize("method", METHODS)
def test_refuses_what_does_not_fit(method, lab, uniform):
    g = np.full(lab.shape, 0.5, np.float32)
    broken = g.copy()
    broken[3, 4] = np.nan
    for photo in (g[1:], broken):
        with pytest.raises(ValueError, match="photo"):
            method(photo, uniform)
