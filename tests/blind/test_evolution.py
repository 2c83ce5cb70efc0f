"""The evolution of a place to where a rough objective is lower."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.blind.descent import descent
from deshake.blind.evolution import evolved
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable

PLACE = np.linspace(-1.0, 1.0, 10)


def rough_bowl(place: np.ndarray) -> float:
    """Return a bowl about PLACE, with ripples that hide its gradient."""
    away = place - PLACE
    return float(away @ away + 0.05 * np.sin(40 * place).sum())


def always(objective: Callable[[np.ndarray], float]):
    """Return objectives of generations that are all the same."""
    return lambda _number, _mean: objective


def test_it_ends_near_the_minimum_where_a_gradient_misleads() -> None:
    def with_gradient(place: np.ndarray) -> tuple[float, np.ndarray]:
        return rough_bowl(place), 2 * (place - PLACE) + 2 * np.cos(40 * place)

    value, _ = descent(with_gradient, np.zeros(10), 200)
    end = evolved(always(rough_bowl), np.full(10, 0.5), 1500, Run(1))
    assert rough_bowl(end) < value - 1
    assert np.abs(end - PLACE).max() < 0.3


def test_more_evaluations_end_lower() -> None:
    ends = [evolved(always(rough_bowl), np.full(10, 0.5), n, Run(1)) for n in (1, 100, 800)]
    values = [rough_bowl(end) for end in ends]
    assert rough_bowl(np.zeros(10)) > values[0] > values[1] > values[2]


@pytest.mark.parametrize("evaluations", [1, 50, 99])
def test_whole_generations_are_computed_and_one_at_least(evaluations) -> None:
    count = 0

    def counted(place: np.ndarray) -> float:
        nonlocal count
        count += 1
        return rough_bowl(place)

    evolved(always(counted), np.ones(10), evaluations, Run(1))
    assert count == 10 * max(evaluations // 10, 1)


def test_the_widths_are_those_of_the_first_places() -> None:
    widths = np.array([0.01, 0.1, 1.0, 10.0])
    places: list[np.ndarray] = []
    evolved(always(lambda place: float(places.append(place) or 0)), widths, 4000, Run(1))
    first = np.array(places[:8])
    assert (np.abs(first).max(0) > 0.3 * widths).all()
    assert (np.abs(first).max(0) < 4 * widths).all()


def test_threads_change_nothing_and_the_progress_rises_to_the_end() -> None:
    shares: list[float] = []
    run = Run(1, lambda share, _: shares.append(share))
    one = evolved(always(rough_bowl), np.ones(10), 200, run)
    three = evolved(always(rough_bowl), np.ones(10), 200, Run(3))
    np.testing.assert_array_equal(one, three)
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_each_generation_has_an_objective_of_its_own() -> None:
    """Each sees two coordinates; together they see all."""
    seen: list[tuple[int, np.ndarray]] = []

    def objectives(number: int, mean: np.ndarray):
        seen.append((number, mean))
        some = [number % 5, number % 5 + 5]
        return lambda place: float(np.square(place[some] - PLACE[some]).sum())

    end = evolved(objectives, np.full(10, 0.5), 3000, Run(1))
    assert [number for number, _ in seen] == list(range(300))
    np.testing.assert_array_equal(seen[0][1], np.zeros(10))
    assert np.abs(end - PLACE).max() < 0.3
    assert np.abs(seen[-1][1] - end).max() < 0.1
