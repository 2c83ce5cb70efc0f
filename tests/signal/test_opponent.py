from __future__ import annotations

import numpy as np
import pytest

from deshake.signal.opponent import plane_weights, reflect, squared_lengths, weigh_colour


def image(count, seed=0):
    return np.random.default_rng(seed).normal(size=(count, 7, 9)).astype(np.float32)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_the_reflection_is_its_own_inverse_and_keeps_lengths(count):
    x = image(count)
    y = x.copy()
    reflect(y)
    np.testing.assert_allclose(np.square(y).sum(0), np.square(x).sum(0), rtol=1e-4)
    reflect(y)
    np.testing.assert_allclose(y, x, atol=1e-5)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_grey_has_light_only_and_light_goes_first(count):
    x = np.repeat(image(1), count, 0)
    y = x.copy()
    reflect(y)
    np.testing.assert_allclose(y[0], np.sqrt(count) * x[0], rtol=1e-5)
    np.testing.assert_allclose(y[1:], 0, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_weights_lengths_and_matrix_agree(count):
    x, k = image(count), 1.7
    y = x.copy()
    reflect(y)
    by_planes = (plane_weights(count, k)[:, None, None] * np.square(y)).sum(0)
    weighed = x.copy()
    weigh_colour(weighed, k)
    np.testing.assert_allclose(squared_lengths(x, k), by_planes, rtol=1e-4)
    np.testing.assert_allclose((x * weighed).sum(0), by_planes, rtol=1e-4)
    assert plane_weights(count, k)[0] == 1


def test_the_matrix_is_half_the_gradient_of_the_length():
    x, k, step = image(3).astype(np.float64), 1.5, 1e-6
    weighed = x.copy()
    weigh_colour(weighed, k)
    for c in range(3):
        moved = [x.copy(), x.copy()]
        moved[0][c] -= step
        moved[1][c] += step
        slope = (squared_lengths(moved[1], k) - squared_lengths(moved[0], k)) / (2 * step)
        np.testing.assert_allclose(slope, 2 * weighed[c], atol=1e-5)
