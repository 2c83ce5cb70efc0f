from __future__ import annotations

import numpy as np
import pytest

from deshake.operators import gram
from deshake.operators.gram import patch_grams


def random_taps(count: int, size: int, n: int, *, seed: int = 0) -> tuple:
    rng = np.random.default_rng(seed)
    corner = rng.integers(0, n - 1, (2, count, size, 1))
    y = (corner[0] + [0, 0, 1, 1]).astype(np.int32)
    x = (corner[1] + [0, 1, 0, 1]).astype(np.int32)
    return y, x, rng.random((count, size, 4)).astype(np.float32)


def expected_gram(
    y: np.ndarray, x: np.ndarray, share: np.ndarray, ac: np.ndarray, local: np.ndarray | None
) -> np.ndarray:
    """The sum over patches and pairs of taps, written out."""
    middle = ac.shape[1] // 2
    total = 0
    for p in range(len(y)):
        dy = y[p][None, :, None, :] - y[p][:, None, :, None]
        dx = x[p][None, :, None, :] - x[p][:, None, :, None]
        lags = ac[p][dy + middle, dx + middle].astype(np.float64)
        if local is not None:
            lags += np.where((dy == 0) & (dx == 0), local[p][y[p], x[p]][:, None, :, None], 0)
        total = total + np.einsum("ka,lb,klab->kl", share[p], share[p], lags)
    return total


@pytest.mark.parametrize("size", [3, 40, 300])
@pytest.mark.parametrize("n", [5, 21])
@pytest.mark.parametrize("with_local", [False, True])
def test_upper_triangle_is_the_sum_over_taps(*, size: int, n: int, with_local: bool) -> None:
    y, x, share = random_taps(3, size, n)
    rng = np.random.default_rng(1)
    ac = rng.random((3, 2 * n - 1, 2 * n - 1)).astype(np.float32)
    ac += ac[:, ::-1, ::-1]  # as every autocorrelation is
    local = rng.random((3, n, n)).astype(np.float32) if with_local else None
    grams = patch_grams(y, x, share, ac, local)
    expected = expected_gram(y, x, share, ac, local)
    upper = np.triu_indices(size)
    np.testing.assert_allclose(grams[upper], expected[upper], rtol=1e-4)


def test_both_ways_to_lay_out_places_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    y, x, share = random_taps(2, 60, 9)
    ac = np.random.default_rng(1).random((2, 17, 17)).astype(np.float32)
    ac += ac[:, ::-1, ::-1]
    results = []
    for full in (0.0, 1.0):
        monkeypatch.setattr(gram, "_FULL_BOX", full)
        results.append(patch_grams(y, x, share, ac, None))
    np.testing.assert_allclose(results[0], results[1], rtol=1e-5)
