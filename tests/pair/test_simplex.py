from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from deshake.pair.simplex import least_eigenvalue, least_on_simplex, pairwise_descent


def problem(count, *, rows=None, seed=0):
    """Gram matrix of smooth columns, and the right side of a sparse target with noise."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 6, (count, 2))
    pixels = rng.uniform(-1, 7, (rows or 3 * count, 2))
    b = np.exp(-((pixels[:, None] - places) ** 2).sum(-1))
    truth = np.zeros(count)
    truth[rng.choice(count, max(count // 8, 2), replace=False)] = 1
    g = b @ (truth / truth.sum()) + 0.01 * rng.normal(size=len(pixels))
    return b.T @ b, b.T @ g


def value(gram, right, w):
    return w @ gram @ w / 2 - right @ w


def gap(gram, right, w):
    """By how much the Kuhn-Tucker conditions fail, in the largest slope."""
    slope = gram @ w - right
    return (slope[w > 0].max() - slope.min()) / max(np.abs(slope).max(), np.abs(right).max())


class Parts:
    """A least-squares problem that counts how much of G it is asked for."""

    def __init__(self, gram, right):
        self.whole, self.right = gram, right
        self.largest = 0

    def gram(self, chosen):
        self.largest = max(self.largest, len(chosen))
        return self.whole[np.ix_(chosen, chosen)]

    def slope(self, w):
        return self.whole @ w - self.right


@pytest.mark.parametrize(("count", "rows"), [(2, 6), (9, 30), (25, 80), (40, 20)])
def test_the_minimum_is_that_of_a_general_solver(count, rows):
    gram, right = problem(count, rows=rows, seed=count)
    gram += 1e-3 * np.eye(count)
    weights = pairwise_descent(gram, right, np.full(count, 1 / count))
    other = minimize(
        lambda w: value(gram, right, w),
        np.full(count, 1 / count),
        jac=lambda w: gram @ w - right,
        bounds=[(0, 1)] * count,
        constraints={"type": "eq", "fun": lambda w: w.sum() - 1, "jac": np.ones_like},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 2000},
    ).x
    assert weights.sum() == pytest.approx(1, abs=1e-12)
    assert weights.min() >= 0
    assert value(gram, right, weights) <= value(gram, right, other) + 1e-8 * abs(right).max()
    np.testing.assert_allclose(weights, other, atol=3e-3)


@pytest.mark.parametrize("seed", range(4))
def test_no_weight_gains_by_taking_from_another(seed):
    gram, right = problem(120, seed=seed)
    start = np.random.default_rng(seed).random(120)
    weights = least_on_simplex(Parts(gram, right), start, ridge=1e-3)
    gram += 1e-3 * np.diagonal(gram).mean() * np.eye(120)
    assert gap(gram, right, weights) < 3e-6
    assert np.count_nonzero(weights) < 120
    assert weights.sum() == pytest.approx(1, abs=1e-12)


def test_the_start_does_not_matter():
    gram, right = problem(60)
    gram += 1e-2 * np.eye(60)
    ends = [np.eye(60)[0], np.eye(60)[59], np.full(60, 1 / 60)]
    solutions = [pairwise_descent(gram, right, start) for start in ends]
    np.testing.assert_allclose(solutions[1:], solutions[:1] * 2, atol=1e-4)


def test_a_working_set_ends_where_all_of_them_do():
    gram, right = problem(1100, rows=300, seed=3)
    parts = Parts(gram, right)
    start = np.ones(1100)
    ridge = 1e-3
    by_sets = least_on_simplex(parts, start, ridge=ridge, whole=600)
    assert parts.largest <= 900
    at_once = least_on_simplex(parts, start, ridge=ridge)
    assert parts.largest == 1100
    raised = gram + ridge * np.diagonal(gram).mean() * np.eye(1100)
    assert gap(raised, right, by_sets) < 1e-4
    assert value(raised, right, by_sets) == pytest.approx(value(raised, right, at_once), rel=1e-4)


def test_a_ridge_makes_an_indefinite_gram_convex():
    gram, right = problem(80)
    rng = np.random.default_rng(5)
    noise = rng.normal(size=(80, 80))
    gram += 0.3 * (noise + noise.T)
    least = np.linalg.eigvalsh(gram)[0]
    assert least < -0.1 * np.diagonal(gram).mean()
    weights = least_on_simplex(Parts(gram, right), np.ones(80), ridge=0.01)
    raised = gram - 1.05 * least * np.eye(80)
    assert gap(raised, right, weights) < 1e-4
    for _ in range(100):
        other = rng.dirichlet(np.full(80, 0.1))
        assert value(raised, right, weights) < value(raised, right, other)


@pytest.mark.parametrize("count", [30, 400])
def test_least_eigenvalue(count):
    rng = np.random.default_rng(count)
    noise = rng.normal(size=(count, count))
    gram = noise @ noise.T / count - 0.5 * np.eye(count)
    gram += np.outer(np.ones(count), np.ones(count)) / count
    exact = np.linalg.eigvalsh(gram)
    eigenvalue = least_eigenvalue(gram)
    assert exact[0] - 1e-9 <= eigenvalue <= exact[0] + 0.01 * (exact[-1] - exact[0])


def test_least_eigenvalue_of_nothing_is_nothing():
    assert least_eigenvalue(np.zeros((300, 300))) == pytest.approx(0, abs=1e-12)


def test_no_data_change_no_weights():
    weights = least_on_simplex(Parts(np.zeros((4, 4)), np.zeros(4)), [1, 2, 3, 2])
    np.testing.assert_allclose(weights, [0.125, 0.25, 0.375, 0.25])
