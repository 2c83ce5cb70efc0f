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
    return [Entry(str(i), i, 0, k) for i, k in enumerate((true, mirrored, twice, point))]


def test_the_true_kernel_has_the_highest_score(entries, pyramid) -> None:
    scores = Comparison(pyramid).scores(entries)
    assert scores.shape == (4,)
    assert np.argmax(scores) == 0


def test_a_point_is_penalised(entries, pyramid) -> None:
    assert Comparison(pyramid).scores(entries)[3] < 1 - COLLAPSED


def test_the_score_of_a_kernel_alone_does_not_depend_on_others(entries, pyramid) -> None:
    comparison = Comparison(pyramid)
    alone = comparison.scores(entries[:1])[0]
    assert comparison.scores(entries)[0] == pytest.approx(alone, abs=0.02)


def test_the_sharpness_of_the_restored_picture_counts(entries, pyramid) -> None:
    comparison = Comparison(pyramid)
    judge = comparison.judge(entries[0])
    score = entries[0].margin(judge) + 0.3 * judge.sharpening(entries[0].kernel)
    assert comparison.scores(entries[:1])[0] == pytest.approx(score)
