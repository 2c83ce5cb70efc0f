from __future__ import annotations

import numpy as np
import pytest

from deshake.signal.poisson import poisson_image

SHAPES = [(37, 50), (64, 64), (1, 23), (17, 1), (2, 2), (1, 1)]


def gradients(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Differences to the right and lower neighbour; values without a neighbour are arbitrary."""
    across, down = np.full(picture.shape, 7.0), np.full(picture.shape, -7.0)
    across[:, :-1], down[:-1] = np.diff(picture, axis=1), np.diff(picture, axis=0)
    return across, down


def energy(picture: np.ndarray, across: np.ndarray, down: np.ndarray) -> float:
    misfit_x = np.diff(picture, axis=1) - across[:, :-1]
    misfit_y = np.diff(picture, axis=0) - down[:-1]
    return float((misfit_x**2).sum() + (misfit_y**2).sum())


def noise(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(2, *shape))


@pytest.mark.parametrize("shape", SHAPES)
def test_a_picture_comes_back_from_its_own_gradients(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(1).random(shape)
    picture_again = poisson_image(*gradients(picture), float(picture.mean()))
    assert picture_again.dtype == np.float32
    np.testing.assert_allclose(picture_again, picture, atol=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_mean_is_what_is_asked_for(shape: tuple[int, int]) -> None:
    assert poisson_image(*noise(shape), 0.4).mean(dtype=np.float64) == pytest.approx(0.4, abs=1e-5)


def test_gradients_of_no_picture_are_met_in_least_squares() -> None:
    across, down = noise((23, 31))
    best = poisson_image(across, down, 0.0).astype(np.float64)
    least = energy(best, across, down)
    assert least > 100  # no picture has these gradients
    rng = np.random.default_rng(2)
    step = 1e-2
    for _ in range(20):
        way = rng.normal(size=best.shape)
        up = energy(best + step * way, across, down)
        under = energy(best - step * way, across, down)
        assert up > least
        assert under > least
        assert abs(up - under) / (2 * step) < 1e-3  # the slope, that of a minimum


def test_the_normal_equations_hold() -> None:
    across, down = noise((9, 12))
    count = 9 * 12
    unit = np.eye(count).reshape(count, 9, 12)
    rows = np.concatenate(
        [np.diff(unit, axis=2).reshape(count, -1), np.diff(unit, axis=1).reshape(count, -1)], 1
    ).T
    given = np.concatenate([across[:, :-1].ravel(), down[:-1].ravel()])
    want = np.linalg.lstsq(rows, given, rcond=None)[0].reshape(9, 12)
    solution = poisson_image(across, down, 0.5)
    np.testing.assert_allclose(solution, want - want.mean() + 0.5, atol=1e-5)


def test_it_is_linear() -> None:
    one, other = noise((20, 15), 3), noise((20, 15), 4)
    both = poisson_image(*(2 * one - 3 * other), 2 * 0.1 - 3 * 0.2)
    apart = 2 * poisson_image(*one, 0.1) - 3 * poisson_image(*other, 0.2)
    np.testing.assert_allclose(both, apart, atol=1e-4)


@pytest.mark.parametrize("shapes", [((4, 5), (5, 4)), ((4, 5), (4, 6)), ((4, 5, 3), (4, 5, 3))])
def test_gradients_that_do_not_belong_together_are_refused(
    shapes: tuple[tuple[int, ...], tuple[int, ...]],
) -> None:
    with pytest.raises(ValueError, match="not those of one picture"):
        poisson_image(np.zeros(shapes[0]), np.zeros(shapes[1]), 0.0)
