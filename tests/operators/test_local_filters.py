from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy.signal

from deshake.operators.local_filters import LocalFilters
from deshake.operators.patches import PatchGrid
from deshake.run import Run

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
        grid = PatchGrid((50, 67), 4, 9, margin, run=Run(2))
        blur = random_filters(grid)
        error = dot_test(blur.forward, blur.adjoint, (2, *grid.latent_shape), (2, 50, 67))
        assert error <= 1e-5


def test_equal_filters_are_a_correlation() -> None:
    grid = PatchGrid((50, 67), 4, 9, 4, run=Run(2))
    one = np.random.default_rng(0).random((9, 9)).astype(np.float32) / 40
    blur = LocalFilters(grid, lambda strip: np.repeat(one[None], strip.count, 0))
    f = np.random.default_rng(1).random((1, *grid.latent_shape)).astype(np.float32)
    expected = scipy.signal.correlate(f[0], one, "valid", "direct")
    np.testing.assert_allclose(blur.forward(f)[0], expected, atol=1e-5)


def test_patches_fade_from_filter_to_filter() -> None:
    """Filters that scale by the patch's column make a ramp, linear between the patches."""
    grid = PatchGrid((20, 60), 2, 10, 2, run=Run(1))

    def filters(strip: Strip) -> np.ndarray:
        taps = np.zeros((strip.count, 5, 5), np.float32)
        taps[:, 2, 2] = np.arange(strip.first, strip.last)
        return taps

    flat = np.ones((1, *grid.latent_shape), np.float32)
    ramp = LocalFilters(grid, filters).forward(flat)[0]
    np.testing.assert_allclose(ramp, np.tile((np.arange(60) + 0.5) / 10, (20, 1)), atol=1e-5)


@pytest.mark.parametrize("margin", [4, 11])
def test_near_marked_pixels_the_patches_that_see_them_are_enough(
    dot_test: Callable[..., float], margin: int
) -> None:
    grid = PatchGrid((90, 67), 4, 9, margin, run=Run(2))
    blur = random_filters(grid)
    marked = np.zeros(grid.latent_shape, bool)
    marked[margin + 30, margin + 40 : margin + 44] = marked[0, 0] = True
    near = blur.near(marked)
    assert 0 < len(near.grid.strips) < len(grid.strips) / 2
    assert dot_test(near.forward, near.adjoint, (2, *grid.latent_shape), (2, 90, 67)) <= 1e-5

    rng = np.random.default_rng(5)
    f = rng.random((2, *grid.latent_shape)).astype(np.float32)
    g = rng.random((2, 90, 67)).astype(np.float32)
    np.testing.assert_array_equal(near.adjoint(g)[:, marked], blur.adjoint(g)[:, marked])
    reached = np.s_[:, 26:35, 36:48]  # the radius of a filter is 4
    np.testing.assert_array_equal(near.forward(f)[reached], blur.forward(f)[reached])
    far = np.s_[:, 70:]
    assert not near.forward(f)[far].any()
    assert near.forward(f).shape == g.shape


def test_the_marked_pixels_are_those_of_a_latent_image() -> None:
    blur = random_filters(PatchGrid((50, 67), 4, 9, 4, run=Run(1)))
    with pytest.raises(ValueError, match="50"):
        blur.near(np.zeros((50, 67), bool))


def counted_filters(grid: PatchGrid, budget: int) -> tuple[LocalFilters, list[Strip]]:
    """The same filters, with a list of the strips that they were computed for."""
    calls: list[Strip] = []
    plain = random_filters(grid)

    def counted(strip: Strip) -> np.ndarray:
        calls.append(strip)
        return plain.filters(strip)

    return LocalFilters(grid, counted, budget=budget), calls


def kept_bytes(blur: LocalFilters) -> int:
    return sum(a.nbytes for kept in (blur._filters, blur._spectra) for a in kept.values())


def test_spectra_are_kept() -> None:
    grid = PatchGrid((50, 67), 4, 9, 4, run=Run(1))
    blur, calls = counted_filters(grid, 1 << 30)
    f = np.ones((1, *grid.latent_shape), np.float32)
    blur.adjoint(blur.forward(f))
    assert calls == grid.strips
    assert list(blur._spectra) == grid.strips


# all spectra take 370 kB, all filters 20 kB
@pytest.mark.parametrize("budget", [0, 8_000, 30_000, 150_000, 1 << 30])
@pytest.mark.parametrize("threads", [1, 3])
def test_the_budget_changes_no_result(budget: int, threads: int) -> None:
    grid = PatchGrid((50, 67), 4, 9, 4, run=Run(threads))
    blur, calls = counted_filters(grid, budget)
    rng = np.random.default_rng(0)
    f, g = rng.random((1, *grid.latent_shape), np.float32), rng.random((1, 50, 67), np.float32)
    plain = random_filters(grid)
    for _ in range(2):
        assert blur.forward(f).tobytes() == plain.forward(f).tobytes()
        assert blur.adjoint(g).tobytes() == plain.adjoint(g).tobytes()
        assert kept_bytes(blur) <= budget
    if budget == 0:
        assert len(calls) == 4 * len(grid.strips)
    if budget >= 30_000:
        assert sorted(calls, key=grid.strips.index) == grid.strips
    if budget in {8_000, 150_000}:  # part of one kind is kept
        assert 0 < len(blur._filters) < len(grid.strips)
