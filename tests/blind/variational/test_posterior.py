from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.integrate import quad

from deshake.blind.variational.posterior import (
    gradient_precision,
    rectified_moments,
    start,
    weight_rate,
)
from deshake.blind.variational.priors import KERNEL_PRIOR, ExponentialMixture, GaussianMixture

if TYPE_CHECKING:
    from collections.abc import Callable

PRIOR = GaussianMixture(np.array([0.3, 0.7]), np.array([0.2, 6.0]))


def responsibilities(second: np.ndarray) -> np.ndarray:
    lam = PRIOR.pi * np.sqrt(PRIOR.gamma) * np.exp(-PRIOR.gamma * second / 2)
    return lam / lam.sum(1, keepdims=True)


@pytest.mark.parametrize("x2", [1e-3, 1.0, 4e5])
@pytest.mark.parametrize("t", [-40, -25.1, -10, -1, -0.01, 0, 0.5, 3, 10, 24.9, 25.1, 60, 400])
def test_rectified_moments_are_those_of_integration(t: float, x2: float) -> None:
    x1 = -t * np.sqrt(2 * x2)
    mode = max(x1 / x2, 0.0)
    width = 1 / np.sqrt(x2) if t <= 1 else 1 / -x1
    span = 0.0 if t > -1 else max(mode - 12 * width, 0.0), mode + (14 if t <= 1 else 45) * width
    top = x1 * mode - x2 * mode**2 / 2

    def integral(factor: Callable[[float], float]) -> float:
        def inner(s: float) -> float:
            w = s * width
            return factor(w) * np.exp(x1 * w - x2 * w * w / 2 - top)

        ends = span[0] / width, span[1] / width
        return quad(inner, *ends, points=[mode / width], epsabs=0, epsrel=1e-11, limit=400)[0]

    z = integral(lambda _: 1.0)
    mean = integral(lambda w: w) / z
    second = integral(lambda w: w * w) / z
    log_q = integral(lambda w: x1 * w - x2 * w * w / 2 - top) / z - np.log(z * width)
    moments = rectified_moments(x1, x2)
    assert moments[0] == pytest.approx(mean, rel=1e-7)
    assert moments[1] == pytest.approx(second, rel=1e-6)
    assert moments[2] == pytest.approx(log_q, abs=1e-6 * max(abs(log_q), 1))


@pytest.mark.parametrize("t", [-25.0, 25.0])
def test_rectified_moments_are_continuous_where_the_series_begins(t: float) -> None:
    x2 = 300.0
    below, above = (rectified_moments(-(t + e) * np.sqrt(2 * x2), x2) for e in (-1e-10, 1e-10))
    np.testing.assert_allclose(below, above, rtol=1e-6)
    assert above[1] > above[0] ** 2


def test_gradients_have_the_expected_precision() -> None:
    second = np.array([[0.0, 0.01, 1.0], [50.0, 200.0, 1e6]], np.float32)
    precision, bound = gradient_precision(second, PRIOR)
    np.testing.assert_allclose(precision[1, 2], PRIOR.gamma.min())
    lam = responsibilities(second.astype(np.float64).ravel()[:5, None])
    np.testing.assert_allclose(precision.ravel()[:5], lam @ PRIOR.gamma, rtol=1e-5)
    mixture = PRIOR.pi * np.sqrt(PRIOR.gamma / (2 * np.pi))
    few = second.ravel()[:3, None].astype(np.float64)
    _, part = gradient_precision(second[:1], PRIOR)
    expected = -np.log((mixture * np.exp(-PRIOR.gamma * few / 2)).sum(1)).sum()
    assert part == pytest.approx(expected, rel=1e-5)
    assert np.isfinite(bound)


def test_weights_have_the_expected_rate() -> None:
    prior = ExponentialMixture(np.array([0.25, 0.75]), np.array([100.0, 2.0]))
    w = np.array([0.0, 0.01, 0.5])
    rate, shares, bound = weight_rate(w, prior)
    part = prior.rho * prior.rate * np.exp(-prior.rate * w[:, None])
    kappa = part / part.sum(1, keepdims=True)
    np.testing.assert_allclose(rate, kappa @ prior.rate)
    np.testing.assert_allclose(shares, (1 + kappa.sum(0)) / 5)
    assert bound == pytest.approx(-np.log(part.sum(1)).sum())


def test_a_scale_begins_with_certain_means() -> None:
    f = np.ones((2, 3, 4))
    q = start(f, [0.25, 0.75], w_var=1e-8)
    np.testing.assert_array_equal(q.f, f)
    np.testing.assert_array_equal(q.w, [0.25, 0.75])
    np.testing.assert_allclose(q.w_entropy, -0.5 * np.log(2 * np.pi * np.e * 1e-8))
    np.testing.assert_array_equal(q.rho, KERNEL_PRIOR.rho)
    assert q.f_var.shape == q.f.shape
