from __future__ import annotations

import numpy as np
import pytest

from deshake.signal.gradients import adjoint_differences, differences, strong

SHAPES = [(12, 15), (3, 9, 8), (2, 2, 7, 10)]


def noise(shape: tuple[int, ...], seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


@pytest.mark.parametrize("shape", SHAPES)
def test_differences_are_those_to_the_right_and_below(shape) -> None:
    blocks = noise(shape, 0)
    across, down = differences(blocks)
    np.testing.assert_array_equal(across, np.roll(blocks, -1, -1) - blocks)
    np.testing.assert_array_equal(down, np.roll(blocks, -1, -2) - blocks)
    assert across.dtype == down.dtype == np.float32


@pytest.mark.parametrize("shape", SHAPES)
def test_the_adjoint_is_the_transpose(shape) -> None:
    blocks, across, down = (noise(shape, seed).astype(np.float64) for seed in range(3))
    x, y = differences(blocks)
    left = np.vdot(x, across) + np.vdot(y, down)
    right = np.vdot(blocks, adjoint_differences(across, down))
    assert left == pytest.approx(right, rel=1e-12)


def test_both_are_linear() -> None:
    one, other, more, most = (noise((3, 8, 11), seed).astype(np.float64) for seed in range(4))
    for got, a, b in zip(
        differences(2 * one - 3 * other), differences(one), differences(other), strict=True
    ):
        np.testing.assert_allclose(got, 2 * a - 3 * b, atol=1e-12)
    np.testing.assert_allclose(
        adjoint_differences(2 * one - 3 * more, 2 * other - 3 * most),
        2 * adjoint_differences(one, other) - 3 * adjoint_differences(more, most),
        atol=1e-12,
    )


def test_the_adjoint_leaves_its_input_alone() -> None:
    across, down = noise((2, 6, 6), 0), noise((2, 6, 6), 1)
    before = across.copy(), down.copy()
    adjoint_differences(across, down)
    np.testing.assert_array_equal(across, before[0])
    np.testing.assert_array_equal(down, before[1])


def test_weak_gradients_are_set_to_zero_in_place() -> None:
    across, down = noise((2, 20, 20), 0), noise((2, 20, 20), 1)
    before = across.copy(), down.copy()
    x, y = strong(across, down, 1.5)
    assert x is across
    assert y is down
    kept = before[0] ** 2 + before[1] ** 2 >= np.float32(1.5)
    assert 0.1 < kept.mean() < 0.9
    np.testing.assert_array_equal(x, before[0] * kept)
    np.testing.assert_array_equal(y, before[1] * kept)


def test_a_gradient_as_long_as_the_bound_is_strong() -> None:
    across, down = np.float32([[3, 2.99]]), np.float32([[4, 4]])
    x, y = strong(across, down, 25)
    assert x.tolist() == [[3, 0]]
    assert y.tolist() == [[4, 0]]


def test_blocks_in_any_order_of_memory() -> None:
    turned = noise((3, 11, 8), 0).swapaxes(1, 2)
    plain = np.ascontiguousarray(turned)
    for got, expected in zip(differences(turned), differences(plain), strict=True):
        np.testing.assert_array_equal(got, expected)
    np.testing.assert_array_equal(
        adjoint_differences(turned, turned[::-1]), adjoint_differences(plain, plain[::-1])
    )
