from __future__ import annotations

import numpy as np
import pytest

from deshake.signal.shrinkage import lengths, shrunk


@pytest.mark.parametrize("threshold", [0.01, 1.0, 30.0])
def test_lengths_shrink_to_the_minimum(threshold):
    n = np.linspace(0.01, 20, 40, dtype=np.float32)
    u = np.linspace(0, 20, 20_001)
    energy = threshold * u**0.6 + (u - n[:, None]) ** 2 / 2
    least = energy.min(1)
    ours = n * shrunk(n, threshold, 0.6)
    cost = threshold * ours**0.6 + (ours - n) ** 2 / 2
    np.testing.assert_allclose(cost, least, rtol=1e-3, atol=1e-5)


def test_short_ones_go_and_long_ones_stay():
    share = shrunk(np.array([0, 0.5, 100], np.float32), 1.0, 0.6)
    assert share[:2].tolist() == [0, 0]
    assert 0.99 < share[2] < 1


def test_lengths_take_colours_and_directions_together():
    down = np.array([[[3.0]], [[0.0]], [[0.0]]], np.float32)
    across = np.array([[[0.0]], [[0.0]], [[4.0]]], np.float32)
    assert lengths(down, across).tolist() == [[5.0]]
