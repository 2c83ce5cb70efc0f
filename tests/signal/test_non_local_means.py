from __future__ import annotations

import numpy as np
import pytest

from deshake.run import Run
from deshake.signal import non_local_means as module
from deshake.signal.non_local_means import non_local_means


def noise(shape, sigma=1.0, seed=0):
    return np.random.default_rng(seed).normal(0, sigma, shape).astype(np.float32)


def by_definition(u, sigma):
    """Find every weight by itself, for an image (C, h, w) that reflects at its borders."""
    _, height, width = u.shape
    reach, patch = module._REACH, module._PATCH
    out = np.empty_like(u, np.float64)
    around = range(-patch, patch + 1)

    def reflected(i, size):
        """Mirror an index of a line that is `size` long."""
        return -1 - i if i < 0 else 2 * size - 1 - i if i >= size else i

    for y, x in np.ndindex(height, width):
        total, weights = np.zeros(len(u)), 0.0
        for b, a in np.ndindex(height, width):
            if (b - y) ** 2 + (a - x) ** 2 > reach**2:
                continue
            # the two patches reflect where the overlap of the image and its shifted self ends
            top, left = max(y - b, 0), max(x - a, 0)
            high, wide = height - abs(b - y), width - abs(a - x)
            squares = []
            for dy in around:
                for dx in around:
                    i = top + reflected(y - top + dy, high)
                    j = left + reflected(x - left + dx, wide)
                    squares.append(np.square(u[:, i, j] - u[:, i + b - y, j + a - x]).mean())
            w = np.exp(-np.mean(squares) / (2 * sigma**2))
            total += w * u[:, b, a]
            weights += w
        out[:, y, x] = total / weights
    return out


def test_is_what_the_formula_says():
    u = noise((2, 9, 11)) + np.linspace(0, 4, 11, dtype=np.float32)
    np.testing.assert_allclose(non_local_means(u, 0.8), by_definition(u, 0.8), atol=1e-5)


def test_noise_falls_and_edges_stay():
    truth = np.zeros((3, 60, 70), np.float32)
    truth[:, :, 35:] = 20
    u = truth + noise(truth.shape)
    v = non_local_means(u, 1.0)
    assert np.std(v - truth) < 0.35
    assert np.abs(v - truth)[:, 3:-3, 34:36].mean() < 0.4


def test_repeated_structure_stays_where_a_mean_would_level_it():
    stripes = np.tile(np.array([0, 0, 8, 8], np.float32), 20)
    truth = np.broadcast_to(stripes, (3, 60, 80))
    v = non_local_means(truth + noise(truth.shape), 1.0)
    assert np.std(v - truth) < 0.4


def test_grey_is_taken_like_colour():
    grey = noise((1, 30, 40))
    thrice = non_local_means(np.repeat(grey, 3, axis=0), 1.0)
    np.testing.assert_allclose(thrice, np.repeat(non_local_means(grey, 1.0), 3, axis=0), atol=1e-5)


def test_tiles_leave_no_seams(monkeypatch: pytest.MonkeyPatch):
    u = noise((3, 90, 75))
    whole = non_local_means(u, 1.0)
    monkeypatch.setattr(module, "_TILE", 32)
    np.testing.assert_allclose(non_local_means(u, 1.0), whole, atol=1e-5)


def test_threads_do_not_change_a_byte(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "_TILE", 32)
    u = noise((3, 70, 70))
    assert (
        non_local_means(u, 1.0, run=Run(1)).tobytes()
        == non_local_means(u, 1.0, run=Run(3)).tobytes()
    )


def test_light_and_scale_change_nothing_else():
    u = noise((3, 40, 40))
    v = non_local_means(u, 1.0)
    np.testing.assert_allclose(non_local_means(u + 50, 1.0) - 50, v, atol=1e-3)
    np.testing.assert_allclose(non_local_means(u * 4, 4.0) / 4, v, atol=1e-5)


@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 2, 40), (3, 7, 3)])
def test_takes_images_smaller_than_its_reach(shape):
    u = noise(shape)
    v = non_local_means(u, 1.0)
    assert v.shape == shape
    assert np.isfinite(v).all()
    assert v.max() <= u.max() + 1e-6
