"""Equations with a positive definite matrix: the solution, bad matrices, and other threads."""

from __future__ import annotations

import ctypes
import threading
import time

import numpy as np
import pytest

from deshake.operators.positive_definite import solved


def _matrix(count: int) -> np.ndarray:
    """Return a positive definite matrix (count, count)."""
    rows = np.random.default_rng(0).normal(size=(count, count))
    return rows @ rows.T + np.eye(count)


@pytest.mark.parametrize("count", [1, 2, 7, 150])
def test_the_solution_fulfils_the_equations(count: int) -> None:
    matrix, x = _matrix(count), np.random.default_rng(1).normal(size=count)

    found = solved(matrix.copy(), matrix @ x)

    np.testing.assert_allclose(found, x, rtol=1e-8)


def test_the_right_side_is_unchanged() -> None:
    right = np.ones(5)

    solved(_matrix(5), right)

    np.testing.assert_array_equal(right, np.ones(5))


def test_a_matrix_that_is_not_positive_definite_is_refused() -> None:
    matrix = np.diag([1.0, 2.0, -1.0])

    with pytest.raises(np.linalg.LinAlgError, match="row 3"):
        solved(matrix, np.ones(3))


@pytest.mark.parametrize(
    "matrix",
    [np.eye(3, dtype=np.float32), np.eye(6)[::2, ::2]],
    ids=["float32", "strided"],
)
def test_memory_of_another_kind_is_refused(matrix: np.ndarray) -> None:
    with pytest.raises(ctypes.ArgumentError):
        solved(matrix, np.ones(3))


@pytest.mark.parametrize("shape", [(2, 2), (9,), (1, 9)])
def test_a_matrix_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="3 x 3"):
        solved(np.ones(shape), np.ones(3))


def test_other_threads_go_on_meanwhile() -> None:
    matrix, right = _matrix(2500), np.ones(2500)
    done, longest = threading.Event(), 0.0

    def turn() -> None:
        nonlocal longest
        last = time.perf_counter()
        while not done.is_set():
            now = time.perf_counter()
            longest = max(longest, now - last)
            last = now

    other = threading.Thread(target=turn)
    other.start()
    begun = time.perf_counter()
    solved(matrix, right)
    taken = time.perf_counter() - begun
    done.set()
    other.join()

    assert longest < taken / 2
