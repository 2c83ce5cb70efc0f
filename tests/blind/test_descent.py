"""The descent to a minimum near a start."""

from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.descent import descent

PLACE = np.array([[1.0, -2, 3], [4, -5, 6]])


def bowl(place: np.ndarray) -> tuple[float, np.ndarray]:
    scales = np.array([1.0, 3, 1, 2, 1, 1])
    away = place - PLACE.ravel()
    return float(scales @ away**2) + 7, 2 * scales * away


def test_the_end_is_the_minimum_in_the_shape_of_the_start() -> None:
    value, end = descent(bowl, np.zeros((2, 3)), 50)
    assert value == pytest.approx(7)
    np.testing.assert_allclose(end, PLACE, atol=1e-4)


def test_few_iterations_end_early_and_lower() -> None:
    start = np.zeros((2, 3))
    value, _ = descent(bowl, start, 1)
    assert 7.01 < value < bowl(start.ravel())[0]


def test_the_end_stays_within_bounds() -> None:
    bounds = [(-1.0, 1.0)] * 6
    _, end = descent(bowl, np.zeros((2, 3)), 50, bounds)
    np.testing.assert_allclose(end, np.clip(PLACE, -1, 1), atol=1e-6)
