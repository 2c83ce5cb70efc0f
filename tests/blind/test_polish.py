from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deshake.blind import polish
from deshake.blind.agreement import agreement
from deshake.blind.entry import Entry
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.polish import polished, polished_on_frame
from deshake.blind.settings import SETTINGS
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.run import Run

FINE = 0.1  # share of the kernel's spread: smoothing of a strict agreement


@pytest.fixture(scope="module")
def thick(shaken, widened) -> Entry:
    """The true kernel, widened by more than a grid step."""
    return Entry("thick", 2, 0, widened(shaken.kernel, 1.2))


@pytest.fixture(scope="module")
def broad(shake):
    """A photo that is shaken by a quarter of its frame, without roll."""
    path = np.array([[-6.0, -30, 0], [-18.0, 12, 0], [-6.0, 25, 0], [26, 30, 0]])
    return shake(Camera.from_focal(2500.0, 270, 300), path=path)


def test_a_kernel_that_is_too_wide_comes_nearer_to_the_truth(thick, pyramid, shaken) -> None:
    shares: list[float] = []
    run = Run(1, lambda share, _: shares.append(share))
    comparison = Comparison(pyramid)
    ((best, _),) = polished(comparison, [thick], [thick], ALL_AXES, run)
    before, after = comparison.scores([thick, best])
    assert after > before + 0.01
    truth = shaken.kernel
    near = agreement(best.kernel, truth, smoothing=FINE)
    assert near > agreement(thick.kernel, truth, smoothing=FINE) + 0.02
    assert best.name == "thick, polished"
    assert shares == sorted(shares)
    assert shares[-1] <= 1


def test_the_better_one_of_two_starts_wins(thick, pyramid) -> None:
    point = thick._replace(name="point", start=4, kernel=RotationKernel.delta(thick.kernel.camera))
    comparison = Comparison(pyramid)
    (best, judge), (other, _) = polished(
        comparison, [point, thick], [thick, point], ALL_AXES, Run()
    )
    assert best.name == "thick, polished"
    assert judge.has_room(best.kernel)
    score, former = comparison.scores_by([(best, judge), (thick, judge)])
    assert score > former
    assert (other.name, other.start) == ("point", 4)


def test_a_point_stays_a_point(thick, pyramid) -> None:
    point = thick._replace(name="point", kernel=RotationKernel.delta(thick.kernel.camera))
    assert polished(Comparison(pyramid), [point], [point], ALL_AXES, Run())[0].entry is point


def test_a_kernel_without_roll_gets_none(thick, pyramid) -> None:
    flat = thick._replace(kernel=thick.kernel.resampled(thick.kernel.steps, (True, True, False)))
    assert not polished(Comparison(pyramid), [flat], [flat], ALL_AXES, Run())[0].entry.rolls


def test_paths_that_are_traced_come_nearer_to_the_truth(shake, monkeypatch) -> None:
    """Without the rounds of tracing, the same polish ends farther from it, with a lower score."""
    path = np.array([[0.0, -17, 0], [8, -11, 0], [-4, -2, 0], [6, 5, 0], [-3, 10, 0], [4, 17, 0]])
    moves = np.array([[-2, 2, 0], [1, -2, 0], [2, 1, 0], [-2, -1, 0], [2, 2, 0], [1, -2, 0]])
    photo = shake(Camera.from_focal(500.0, 360, 560), path=path)
    turned = (path + moves) * grid_steps(photo.camera)
    comparison = Comparison(photo.pyramid)
    entry = Entry("wrong", 0, 1, RotationKernel.from_path(turned, photo.camera).centred())
    assert comparison.level(entry) == 1  # so there is a finer scale
    axes = True, True, False
    ends = []
    for count in (0, SETTINGS.polish.tracings):
        monkeypatch.setattr(polish, "_S", replace(SETTINGS.polish, tracings=count))
        ends += polish.polished(comparison, [entry], [entry], axes, Run())
    scores = comparison.scores_by([(end.entry, end.judge) for end in ends])
    assert scores[1] > scores[0] + 0.002
    near = [agreement(end.entry.kernel, photo.kernel, smoothing=FINE) for end in ends]
    assert near[1] > near[0] + 0.01 > agreement(entry.kernel, photo.kernel, smoothing=FINE)


def test_only_a_kernel_that_is_wide_for_the_frame_is_refined_on_all_of_it(
    broad, thick, pyramid
) -> None:
    wide, narrow = Entry("wide", 0, 3, broad.kernel), thick._replace(level=0)
    for entry, scales in ((wide, broad.pyramid), (narrow, pyramid)):
        comparison = Comparison(scales)
        line = polish._Line(comparison, entry, entry, ALL_AXES)
        assert comparison.is_wide(entry) == (entry is wide)
        assert (line._on_frame in line.ways()) == (entry is wide)
        line.take([])
        assert line._on_frame not in line.ways()  # the first round is enough
        found = line._on_frame()
        assert bool(found) == (entry is wide)
        for one in found:
            assert comparison.is_wide(one)
            assert agreement(one.kernel, entry.kernel) > 0.7


def test_two_kernels_that_are_wide_for_the_frame_share_two_threads(broad, monkeypatch) -> None:
    """Each is refined on the frame within a thread; no work there may wait for another thread."""
    one = Entry("one", 0, 3, broad.kernel)
    other = one._replace(name="other", start=1)
    comparison = Comparison(broad.pyramid, Run(2))
    lines = [polish._Line(comparison, entry, entry, ALL_AXES) for entry in (one, other)]
    before = [line.score for line in lines]
    for line in lines:
        assert line._on_frame()
        monkeypatch.setattr(line, "ways", lambda way=line._on_frame: [way])
    polish._advance(comparison, lines, Run(2))
    assert [line.score for line in lines] >= before
    assert all(line.source is None for line in lines)


def test_a_wide_kernel_that_ends_too_wide_is_refined_on_the_frame_again(broad, widened) -> None:
    shares: list[float] = []
    run = Run(1, lambda share, _: shares.append(share))
    comparison = Comparison(broad.pyramid)
    thick = Entry("thick", 2, 3, widened(broad.kernel, 2.5))
    assert comparison.is_wide(thick)
    best = polished_on_frame(comparison, thick, ALL_AXES, run)
    assert (best.name, best.start) == ("thick, frame", 2)
    own, score = comparison.scores_at(comparison.level(thick), [thick, best])
    assert score > own
    before, after = (agreement(one.kernel, broad.kernel, smoothing=FINE) for one in (thick, best))
    assert after > before + 0.02
    assert shares == sorted(shares)
    assert 0 < shares[-1] <= 1


def test_a_wide_kernel_stays_if_no_refinement_on_the_frame_is_better(broad, monkeypatch) -> None:
    comparison = Comparison(broad.pyramid, Run(2))
    true = Entry("true", 0, 3, broad.kernel)
    assert comparison.is_wide(true)
    turned = true._replace(kernel=replace(true.kernel, theta=-true.kernel.theta[:, [1, 0, 2]]))
    narrow = true._replace(kernel=replace(true.kernel, theta=true.kernel.theta / 9))
    others = iter([turned, None, narrow] * 9)
    monkeypatch.setattr(polish, "on_frame", lambda *_, **__: next(others))
    assert polished_on_frame(comparison, true, ALL_AXES, Run(2)) is true
