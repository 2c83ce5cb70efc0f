from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.signal

from deshake.operators.local_filters import LocalFilters
from deshake.operators.patches import PatchGrid

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.operators.strips import Strip


def random_filters(grid: PatchGrid) -> LocalFilters:
    """A filter of its own for every patch."""

    def filters(strip: Strip) -> np.ndarray:
        rng = np.random.default_rng([strip.row, strip.first])
        return rng.random((strip.count, grid.reach, grid.reach)).astype(np.float32)

    return LocalFilters(grid, filters)


def test_dot_test(dot_test: Callable[..., float]) -> None:
    for margin in (0, 4, 11):
        grid = PatchGrid((50, 67), 4, 9, margin, threads=2)
        blur = random_filters(grid)
        error = dot_test(blur.forward, blur.adjoint, (2, *grid.latent_shape), (2, 50, 67))
        assert error <= 1e-5


def test_equal_filters_are_a_correlation() -> None:
    grid = PatchGrid((50, 67), 4, 9, 4, threads=2)
    one = np.random.default_rng(0).random((9, 9)).astype(np.float32) / 40
    blur = LocalFilters(grid, lambda strip: np.repeat(one[None], strip.count, 0))
    f = np.random.default_rng(1).random((1, *grid.latent_shape)).astype(np.float32)
    expected = scipy.signal.correlate(f[0], one, "valid", "direct")
    np.testing.assert_allclose(blur.forward(f)[0], expected, atol=1e-5)


def test_patches_fade_from_filter_to_filter() -> None:
    """Filters that scale by the patch's column make a ramp, linear between the patches."""
    grid = PatchGrid((20, 60), 2, 10, 2, threads=1)

    def filters(strip: Strip) -> np.ndarray:
        taps = np.zeros((strip.count, 5, 5), np.float32)
        taps[:, 2, 2] = np.arange(strip.first, strip.last)
        return taps

    flat = np.ones((1, *grid.latent_shape), np.float32)
    ramp = LocalFilters(grid, filters).forward(flat)[0]
    np.testing.assert_allclose(ramp, np.tile((np.arange(60) + 0.5) / 10, (20, 1)), atol=1e-5)


def test_spectra_are_kept() -> None:
    grid = PatchGrid((50, 67), 4, 9, 4, threads=1)
    calls: list[Strip] = []
    plain = random_filters(grid)

    def counted(strip: Strip) -> np.ndarray:
        calls.append(strip)
        return plain.filters(strip)

    blur = LocalFilters(grid, counted)
    f = np.ones((1, *grid.latent_shape), np.float32)
    blur.adjoint(blur.forward(f))
    assert calls == grid.strips
