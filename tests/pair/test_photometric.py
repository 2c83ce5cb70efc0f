from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.errors import EstimationError
from deshake.pair.photometric import ToneCurve, brightness_ratio, photometric_scale, tone_curves


@pytest.fixture
def light():
    noise = np.random.default_rng(3).random((96, 128), np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 3) - 0.5
    return np.clip(0.35 + 4 * smooth, 0.02, 0.95).astype(np.float32)


def everywhere(image):
    return np.ones(image.shape[:2], bool)


def test_the_ratio_of_two_exposures(light):
    assert brightness_ratio(light, light / 8) == pytest.approx(8, rel=1e-4)
    turned = np.ascontiguousarray(light[::-1])
    assert brightness_ratio(light, turned / 8) == pytest.approx(8, rel=1e-4)


def test_the_ratio_does_not_follow_clipped_lights(light):
    exposed = np.clip(2 * light, 0, 1)
    assert brightness_ratio(exposed, light / 8) == pytest.approx(16, rel=1e-3)


@pytest.mark.parametrize("ratio", [0.5, 2.0, 64.0])
def test_the_scale_is_exact_without_blur(light, ratio):
    scale = photometric_scale(light, light / np.float32(ratio), everywhere(light))
    assert scale == pytest.approx(ratio, rel=1e-4)


def test_neither_blur_nor_noise_nor_a_new_object_moves_the_scale_much(light):
    rng = np.random.default_rng(0)
    blurred = cv2.blur(light, (7, 1))
    blurred[20:35, 20:35] = 0  # someone walked in
    noisy = (light + rng.normal(0, 0.05, light.shape)).astype(np.float32) / 16
    assert photometric_scale(blurred, noisy, everywhere(light)) == pytest.approx(16, rel=0.05)


def test_only_the_mask_counts(light):
    mask = everywhere(light)
    mask[:, 64:] = False
    dark = light / 4
    dark[:, 64:] = 5
    assert photometric_scale(light, dark, mask) == pytest.approx(4, rel=1e-3)


def test_without_usable_pixels_the_quantiles_give_the_scale(light):
    nothing = np.zeros(light.shape, bool)
    assert photometric_scale(light, light / 4, nothing) == pytest.approx(4, rel=1e-3)


def curve(x):
    """The contrast of a camera: dark shadows, then steep, then a shoulder."""
    return np.clip(0.9 * (x * x * (3 - 2 * x)) + 0.05, 0, 1)


def test_a_curve_is_fitted(light):
    [fitted] = tone_curves(light, curve(light).astype(np.float32), everywhere(light))
    x = np.linspace(*np.quantile(light, [0.1, 0.9]), 50).astype(np.float32)
    assert np.abs(fitted(x) - curve(x)).max() < 0.02
    assert np.abs(fitted.slope(x) - 0.9 * 6 * x * (1 - x)).max() < 0.3


def test_blur_bends_a_curve_less_where_both_are_smoothed_or_blurred(light):
    fine = np.clip(light + 0.3 * (np.random.default_rng(1).random(light.shape) - 0.5), 0, 1)
    blurred = cv2.blur(fine.astype(np.float32), (9, 1))
    x = np.linspace(*np.quantile(blurred, [0.1, 0.9]), 50).astype(np.float32)

    def misfit(f, smooth_px):
        [fitted] = tone_curves(f.astype(np.float32), blurred, everywhere(f), smooth_px=smooth_px)
        return np.abs(fitted(x) - x).max()

    assert misfit(fine, 4) < 0.5 * misfit(fine, 0.5)
    assert misfit(blurred, 1.5) < 0.01


def test_each_channel_has_its_own(light):
    f = np.stack([light, light, light], -1)
    g = f * np.array([1.0, 0.5, 0.25], np.float32)
    slopes = [float(fitted.slope(np.float32(0.4))) for fitted in tone_curves(f, g, everywhere(f))]
    assert slopes == pytest.approx([1, 0.5, 0.25], rel=0.05)


def test_curves_rise_whatever_the_data(light):
    for g in (1 - light, np.random.default_rng(1).random(light.shape, np.float32), light):
        [fitted] = tone_curves(light, g.astype(np.float32), everywhere(light))
        assert np.diff(fitted.values).min() >= 0
        assert np.isfinite(fitted.values).all()
    assert np.diff(fitted.values).min() > 0


def test_curves_continue_straight():
    fitted = ToneCurve(np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.2, 1.0]))
    x = np.array([[-1, -0.5], [0.25, 2]], np.float32)
    assert fitted(x) == pytest.approx(np.array([[-0.4, -0.2], [0.1, 2.6]]), abs=1e-6)
    assert fitted.slope(x)[0] == pytest.approx([0.4, 0.4])
    assert fitted.slope(x)[1, 1] == pytest.approx(1.6)
    assert fitted(x).dtype == fitted.slope(x).dtype == np.float32


def test_the_inverse_takes_values_back():
    x = np.linspace(0, 1, 101)
    fitted = ToneCurve(x, 0.2 + 0.5 * x**2 + 0.1 * x)
    f = np.array([[0.1, 0.55], [0.9, 1.0]], np.float32)
    assert fitted.inverse(fitted(f)) == pytest.approx(f, abs=1e-5)
    assert fitted.inverse(np.float32(0.1)) == 0


def test_noise_on_the_curve_has_no_bias():
    x = np.linspace(0, 1, 101)
    fitted = ToneCurve(x, x**3)
    rng = np.random.default_rng(5)
    clean = np.full((400, 400), 0.3, np.float32)
    noisy = clean + rng.normal(0, 0.15, clean.shape).astype(np.float32)
    truth = 0.3**3
    assert fitted.matched(noisy, clean).mean() == pytest.approx(truth, abs=2e-3)
    assert fitted(noisy).mean() > truth + 0.01


def test_photos_without_a_curve_are_refused(light):
    with pytest.raises(EstimationError, match="too few pixels"):
        tone_curves(light, light, np.zeros(light.shape, bool))
    with pytest.raises(EstimationError, match="too few pixels"):
        tone_curves(light, np.ones_like(light), everywhere(light))
    flat = np.full_like(light, 0.3)
    with pytest.raises(EstimationError, match="too little contrast"):
        tone_curves(flat, flat, everywhere(light))
