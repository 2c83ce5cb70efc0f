from __future__ import annotations

import pytest

from deshake.blind.trust import confidence
from deshake.geometry.kernel import RotationKernel

BLURRED = 0.5


def wide(kernel: RotationKernel, times: int) -> RotationKernel:
    """Widen a kernel so many times."""
    return RotationKernel(times * kernel.theta, kernel.weights, kernel.steps, kernel.camera)


@pytest.mark.parametrize("margin", [-1.0, 0.0, 0.02, 0.2, 5.0])
@pytest.mark.parametrize("agreement", [0.0, 0.8, 1.0, 1.0 + 1e-9])
@pytest.mark.parametrize("sharpness", [0.0, 0.6, 1.0])
def test_it_is_a_chance(ended, margin, agreement, sharpness) -> None:
    assert 0 <= confidence(ended._replace(margin=margin, agreement=agreement), sharpness) <= 1


@pytest.mark.parametrize("agreement", [0.5, 0.8, 0.95])
def test_it_rises_with_the_margin(ended, agreement) -> None:
    chances = [
        confidence(ended._replace(margin=margin, agreement=agreement), BLURRED)
        for margin in (-0.1, 0.0, 0.01, 0.02, 0.05, 0.1, 0.3)
    ]
    assert chances == sorted(chances)
    assert chances[0] < chances[-1]


@pytest.mark.parametrize("margin", [0.0, 0.02, 0.05])
def test_it_rises_with_the_agreement(ended, margin) -> None:
    chances = [
        confidence(ended._replace(margin=margin, agreement=agreement), BLURRED)
        for agreement in (0.1, 0.4, 0.6, 0.8, 0.9, 1.0)
    ]
    assert chances == sorted(chances)
    assert chances[0] < chances[-1]


def test_it_rises_with_the_width(ended) -> None:
    chances = [
        confidence(
            ended._replace(winner=ended.winner._replace(kernel=wide(ended.winner.kernel, times))),
            BLURRED,
        )
        for times in (1, 2, 3)
    ]
    assert chances == sorted(chances)
    assert chances[0] < 0.9 < chances[-1]


def test_the_edges_of_a_shaken_photo_are_not_steep(ended) -> None:
    chances = [confidence(ended, sharpness) for sharpness in (0.5, 0.6, 0.65, 0.7, 1.0)]
    assert chances == sorted(chances, reverse=True)
    assert chances[0] == chances[1]
    assert chances[-1] < 0.05
    assert chances[0] > 0.5


def test_where_nothing_moved_there_is_nothing_to_trust(ended) -> None:
    assert confidence(ended._replace(at_rest=True), BLURRED) == 0
