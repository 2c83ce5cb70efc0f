from __future__ import annotations

import numpy as np
import pytest

from deshake.signal.pair_noise import fitted_noise, noise_of_pair

SLOPE, FLOOR = 0.004, 0.0006


def pair(lab, slope=SLOPE, floor=FLOOR):
    sharp = lab.colours()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.002)
    frame = lab.frame(sharp)
    rng = np.random.default_rng(3)
    noise = rng.normal(size=frame.shape) * np.sqrt(slope * frame + floor)
    return g, (frame + noise).astype(np.float32)


@pytest.mark.parametrize(("slope", "floor"), [(SLOPE, FLOOR), (0.0, 0.0025), (0.02, 0.002)])
def test_the_noise_as_a_function_of_light_is_estimated(lab, slope, floor):
    g, f_N = pair(lab, slope, floor)
    model = noise_of_pair(f_N, g, np.ones(lab.shape, np.float32))
    for light in (0.2, 0.4):
        deviation = np.sqrt(model[0] * light + model[1])
        assert deviation == pytest.approx(np.sqrt(slope * light + floor), rel=0.25)


def test_what_is_not_valid_does_not_count(lab):
    g, f_N = pair(lab)
    valid = np.ones(lab.shape, np.float32)
    valid[:, :80] = 0
    other = np.where(valid[..., None] > 0, f_N, 0.3).astype(np.float32)
    assert noise_of_pair(other, g, valid) == noise_of_pair(f_N, g, valid)


def test_a_photo_without_noise_has_hardly_any():
    g = np.full((60, 80), 0.4, np.float32)
    slope, floor = noise_of_pair(g, g, np.ones(g.shape, np.float32))
    assert slope * 0.4 + floor < 1e-6


def test_too_small_a_photo_has_the_least():
    g = np.full((5, 6), 0.4, np.float32)
    assert noise_of_pair(g, g, np.ones(g.shape, np.float32))[0] == 0


def test_a_line_through_known_variances():
    light = np.random.default_rng(2).random(5000, np.float32)
    assert fitted_noise(light, 0.01 * light + 0.002) == pytest.approx((0.01, 0.002), rel=0.01)
    slope, floor = fitted_noise(light, np.float32(1) - light)
    assert slope == 0
    assert floor > 0
