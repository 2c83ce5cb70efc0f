from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.entry import Entry, best_of_starts, last_of_starts, nearest
from deshake.blind.judge import Judge
from deshake.blind.settings import Refinement
from deshake.geometry.kernel import ALL_AXES, RotationKernel


@pytest.fixture(scope="module")
def entry(shaken) -> Entry:
    camera = shaken.camera
    on_grid = shaken.kernel.resampled(shaken.kernel.steps, ALL_AXES)
    return Entry("truth", 2, 0, on_grid.centred().for_camera(camera))


def test_width_and_the_price_of_a_roll(entry, pyramid, shaken) -> None:
    assert 0.7 * shaken.kernel.extent_px() < entry.width <= 1.1 * entry.kernel.extent_px()
    flat = RotationKernel.from_path(
        np.array([[0.0, -3, 0], [0, 3, 0]]) * shaken.kernel.steps, shaken.camera
    )
    assert entry.rolls
    judge = Judge.of(pyramid, 0, [entry.kernel, flat])
    assert entry.margin(judge) < judge.margin(entry.kernel)
    assert entry._replace(kernel=flat).margin(judge) == judge.margin(flat)


def test_a_refinement_keeps_a_right_kernel_and_names_itself(entry, pyramid, shaken) -> None:
    refined = entry.refined(pyramid, Refinement(2e-3, iterations=1), (True, True, False))
    assert refined.name == "truth, refined at 0.002, no roll"
    assert (refined.start, refined.level) == (entry.start, entry.level)
    assert agreement(refined.kernel, shaken.kernel) > 0.9


def test_a_point_is_not_refined(entry, pyramid) -> None:
    point = entry._replace(kernel=RotationKernel.delta(entry.kernel.camera))
    assert point.refined(pyramid, Refinement(2e-3), ALL_AXES) is point


def test_the_best_of_each_start_comes_first(entry) -> None:
    ranked = [entry._replace(name=f"{start}{i}", start=start) for i, start in enumerate("bacab")]
    assert [one.name for one in best_of_starts(ranked)] == ["b0", "a1", "c2"]
    assert [one.name for one in last_of_starts(ranked)] == ["b4", "a3", "c2"]


def test_nearest_counts_other_starts_alone(entry) -> None:
    twin = entry._replace(name="twin")
    point = entry._replace(start=4, kernel=RotationKernel.delta(entry.kernel.camera))
    assert nearest(entry, [entry, twin]) == 0
    assert nearest(entry, [entry, twin._replace(start=4)]) == pytest.approx(1, abs=1e-3)
    assert nearest(entry, [twin._replace(start=4), point]) < 0.6
