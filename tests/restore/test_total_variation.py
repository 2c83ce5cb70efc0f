from __future__ import annotations

import numpy as np
import pytest

from deshake.restore.total_variation import divergence, gradient, less_varied, variation_weight
from deshake.signal.shrinkage import lengths


def variation(f, weight):
    return float(np.sum(weight * lengths(*gradient(f)), dtype=np.float64))


def cost(f, u, spread, weight):
    """What `less_varied` is to minimise."""
    misfit = np.square(f.astype(np.float64) - u) / (2 * spread)
    return float(misfit.sum()) + variation(f, weight)


@pytest.fixture
def picture():
    """Noisy steps in three colours, and their spreads, 1 : 60."""
    rng = np.random.default_rng(2)
    u = np.repeat(np.repeat(rng.uniform(0.2, 0.8, (3, 5, 6)), 8, 1), 7, 2)
    u += rng.normal(0, 0.05, u.shape)
    spread = rng.uniform(0.05, 3, u.shape)
    weight = rng.uniform(0.02, 0.03, u.shape[1:])
    return tuple(part.astype(np.float32) for part in (u, spread, weight))


@pytest.mark.parametrize("shape", [(3, 17, 23), (1, 1, 9), (1, 9, 1), (2, 1, 1)])
def test_divergence_is_minus_the_gradients_transpose(shape):
    rng = np.random.default_rng(1)
    f, down, across = rng.normal(size=(3, *shape))
    dy, dx = gradient(f)
    left = np.vdot(dy, down) + np.vdot(dx, across)
    assert left == pytest.approx(-np.vdot(f, divergence(down, across)), rel=1e-10, abs=1e-12)


def test_the_gradient_is_linear():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 3, 8, 9))
    both = gradient(2 * a - b)
    for whole, one, other in zip(both, gradient(a), gradient(b), strict=True):
        np.testing.assert_allclose(whole, 2 * one - other, atol=1e-12)


def test_the_divergence_of_directions_is_minus_the_variations_slope():
    rng = np.random.default_rng(3)
    f, d = rng.uniform(0.2, 0.8, (2, 3, 9, 11))
    weight = rng.uniform(0.5, 1, (9, 11))
    dy, dx = gradient(f)
    n = np.maximum(lengths(dy, dx), 1e-12)
    slope = -np.vdot(divergence(weight * dy / n, weight * dx / n), d)
    step = 1e-6
    ahead, behind = (variation(f + sign * step * d, weight) for sign in (1, -1))
    assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-5)


def test_a_step_shrinks_by_what_theory_says():
    u = np.zeros((1, 1, 20), np.float32)
    u[..., :10], u[..., 10:] = 0.2, 0.6
    weight = np.full((1, 20), 0.01, np.float32)
    f = less_varied(u, np.ones_like(u), weight, 3000)
    # ten pixels to each side share what one difference of weight .01 pulls
    np.testing.assert_allclose(f[0, 0], [0.201] * 10 + [0.599] * 10, atol=1e-4)


def test_more_steps_come_closer(picture):
    u, spread, weight = picture
    best = cost(less_varied(u, spread, weight, 500), u, spread, weight)
    costs = [cost(u, u, spread, weight)]
    costs += [cost(less_varied(u, spread, weight, n), u, spread, weight) for n in (1, 4, 16, 64)]
    assert np.all(np.diff(costs) < 0)
    assert best < costs[-1] < best + 0.02 * (costs[0] - best)


def test_no_neighbour_of_the_minimum_is_better(picture):
    u, spread, weight = picture
    f = less_varied(u, spread, weight, 2000)
    rng = np.random.default_rng(4)
    least = cost(f, u, spread, weight)
    for size in (0.001, 0.01):
        for _ in range(5):
            other = f + rng.normal(0, size, f.shape).astype(np.float32)
            assert cost(other, u, spread, weight) > least


def test_rows_far_away_do_not_matter(picture):
    u, spread, weight = picture
    steps = 4
    whole = less_varied(u, spread, weight, steps)
    part = slice(12, 30)
    band = less_varied(u[:, part], spread[:, part], weight[part], steps)
    inside = slice(steps + 1, -steps - 1)
    np.testing.assert_array_equal(band[:, inside], whole[:, part][:, inside])


def test_edges_agree_among_the_colours():
    rng = np.random.default_rng(5)
    edge = np.where(np.arange(40) < 20, 0.3, 0.7) * np.ones((40, 1))
    u = np.stack([edge, np.full((40, 40), 0.5)]) + rng.normal(0, 0.03, (2, 40, 40))
    u = u.astype(np.float32)
    weight = np.full((40, 40), 0.03, np.float32)
    together = less_varied(u, np.ones_like(u), weight, 50)
    alone = less_varied(u[1:], np.ones_like(u[1:]), weight, 50)
    columns = slice(19, 20)  # whose differences across the edge are not smoothed in either
    jump = np.abs(np.diff(together[1], axis=1))[:, columns].mean()
    assert jump > 2 * np.abs(np.diff(alone[0], axis=1))[:, columns].mean()


def test_grey_stays_grey_and_black_stays_black():
    rng = np.random.default_rng(6)
    grey = np.repeat(rng.uniform(0, 1, (1, 20, 30)), 3, 0).astype(np.float32)
    weight = np.full((20, 30), 0.05, np.float32)
    f = less_varied(grey, grey, weight, 4)
    np.testing.assert_array_equal(f, f[:1].repeat(3, 0))
    black = np.zeros_like(grey)
    np.testing.assert_array_equal(less_varied(black, black, weight, 4), 0)


def test_light_stays_positive():
    rng = np.random.default_rng(7)
    u = rng.exponential(0.1, (3, 30, 30)).astype(np.float32)
    weight = np.full((30, 30), 5.0, np.float32)
    f = less_varied(u, 100 * u, weight, 4)
    assert f.min() > 0
    assert np.isfinite(f).all()


def test_the_weight_grows_with_the_noise_and_falls_with_the_light():
    rng = np.random.default_rng(8)
    noise = rng.normal(0, 1, (200, 320, 3))
    ramp = np.linspace(0.05, 0.9, 320)[:, None]
    mild, strong = (variation_weight((ramp + s * noise).astype("f4"), 9) for s in (0.005, 0.02))
    assert mild.shape == (218, 338)
    assert np.median(strong / mild) == pytest.approx(4, rel=0.2)
    assert mild[:, 20].mean() > 5 * mild[:, -20].mean()
    assert mild.min() > 0
    np.testing.assert_array_equal(mild[:, :9], mild[:, 9:10].repeat(9, 1))


def test_the_weight_of_black_photos_is_finite():
    for shape in ((1, 1), (5, 300, 3)):
        weight = variation_weight(np.zeros(shape, np.float32), 3)
        assert np.isfinite(weight).all()
        assert weight.min() > 0
