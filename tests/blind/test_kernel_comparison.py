from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deshake.blind.entry import Entry
from deshake.blind.kernel_comparison import COLLAPSED, Comparison
from deshake.geometry.kernel import RotationKernel


@pytest.fixture(scope="module")
def entries(shaken) -> list[Entry]:
    """The true kernel, its mirror image, twice the kernel, and a camera at rest."""
    true = shaken.kernel
    mirrored = replace(true, theta=true.theta * [1, -1, 1])
    twice = replace(true, theta=2 * true.theta)
    point = RotationKernel.delta(shaken.camera)
    return [Entry("", i, 0, k) for i, k in enumerate((true, mirrored, twice, point))]


@pytest.mark.parametrize("score", ["margins", "side_by_side", "by_sharpness", "by_both"])
def test_the_true_kernel_has_the_highest_score(score, entries, pyramid) -> None:
    scores = getattr(Comparison(pyramid), score)(entries)
    assert scores.shape == (4,)
    assert np.argmax(scores) == 0


def test_a_point_is_penalised_where_kernels_compete(entries, pyramid) -> None:
    comparison = Comparison(pyramid)
    assert comparison.side_by_side(entries)[3] < 1 - COLLAPSED
    assert comparison.by_sharpness(entries)[3] < 1 - COLLAPSED
    assert abs(comparison.margins(entries)[3]) < 0.01


def test_the_score_of_a_kernel_alone_does_not_depend_on_others(entries, pyramid) -> None:
    comparison = Comparison(pyramid)
    alone = comparison.margins(entries[:1])[0]
    assert comparison.margins(entries)[0] == pytest.approx(alone, abs=0.02)
