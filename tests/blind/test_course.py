from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.course import Course, _of_edges, first_scales, selected
from deshake.blind.entry import Entry
from deshake.blind.judge import Judge
from deshake.blind.polish import Polished, polished
from deshake.blind.settings import SETTINGS
from deshake.blind.spot import is_spot
from deshake.blind.trust import confidence
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.run import Run

if TYPE_CHECKING:
    from deshake.blind.finish import Finish
    from deshake.signal.pyramid import Pyramid

pytestmark = pytest.mark.long

ONE = Entry("start 3, scale 0", 3, 0, RotationKernel.delta(Camera.from_focal(64.0, 56, 64)))


@pytest.fixture(scope="module")
def larger(photo) -> Pyramid:
    return photo.pyramid


@pytest.fixture(scope="module")
def course(larger) -> Course:
    return Course(larger, (True, True, True), None, any_focal=False, run=Run())


@pytest.fixture(scope="module")
def spectral(course) -> list[Entry]:
    taken = course.start_spectral(SETTINGS.spectral_start.usual, Run(1))
    assert taken == course.entries
    return taken


def test_spectral_starts_are_distinct_and_take_part_with_their_reflections(
    course, spectral
) -> None:
    assert spectral
    assert len({entry.start for entry in spectral}) == len(spectral)
    for entry, reflected in zip(spectral[::2], spectral[1::2], strict=True):
        turned = replace(entry.kernel, theta=-entry.kernel.theta)
        assert agreement(reflected.kernel, turned) > 0.99
        assert course.comparison.match(reflected) == pytest.approx(
            course.comparison.match(entry), abs=0.03
        )
    firsts = [entry.kernel for entry in spectral[::2]]
    for n, kernel in enumerate(firsts):
        assert all(agreement(kernel, other) < SETTINGS.course.alike for other in firsts[:n])
    assert _of_edges([*spectral, ONE]) == [ONE]


def test_wide_spectral_starts_follow_if_the_best_kernel_is_wide_or_doubtful(
    larger, course, spectral
) -> None:
    known = list(spectral)
    wide = course.start_spectral(SETTINGS.spectral_start.wide, Run(1))
    assert wide
    assert course.entries == [*known, *wide]
    assert len({entry.start for entry in course.entries}) == len(course.entries)
    assert _of_edges(wide) == []
    doubtful = ONE._replace(kernel=RotationKernel.delta(larger.camera))
    assert course.may_be_wide(doubtful)
    broad = max(wide, key=lambda entry: entry.width)
    assert course.comparison.is_wide(broad)
    assert course.may_be_wide(broad)


def test_a_narrow_kernel_beyond_doubt_needs_no_wide_starts(ended, shaken) -> None:
    course = Course(shaken.pyramid, (True, True, True), None, any_focal=False, run=Run())
    course.entries = [ended.winner._replace(start=n) for n in range(4)]
    assert not course.comparison.is_wide(ended.winner)
    assert not course.may_be_wide(ended.winner)


def begun(pyramid: Pyramid) -> Course:
    """Return a course whose starts have run."""
    course = Course(pyramid, (True, True, True), None, any_focal=False, run=Run(1))
    course.begin(first_scales(pyramid.coarsest), Run(1), quick=False)
    course.begin_others(Run(1))
    return course


def test_a_start_of_edges_beyond_doubt_needs_no_others(photo) -> None:
    course = begun(photo.pyramid)
    assert course.sure
    assert course.confidence(course.leaders[0]) >= SETTINGS.estimate.doubtful
    assert all(entry.start >= 0 for entry in course.entries)
    assert sorted(end.start for end in course.ends) == first_scales(photo.pyramid.coarsest)
    assert {path.name for path in course.entries if path.name.endswith("path")} == {
        f"{end.name}, path" for end in course.ends if not is_spot(end.kernel)
    }


def test_starts_of_edges_in_doubt_are_followed_by_others(grainy) -> None:
    course = begun(grainy)
    assert not course.sure
    starts = {end.start for end in course.ends}
    assert any(start < 0 for start in starts)
    assert starts == {entry.start for entry in course.entries}
    assert len(course.ends) == len(starts)


def test_fewer_starts_are_refined_if_one_is_beyond_doubt(photo, monkeypatch) -> None:
    def refined(course: Course) -> set[int]:
        known = len(course.entries)
        course.finish(Run(1))
        return {entry.start for entry in course.entries[known:] if "refined" in entry.name}

    few = refined(begun(photo.pyramid))
    monkeypatch.setattr(Course, "sure", property(lambda _: False))
    many = refined(begun(photo.pyramid))
    assert 1 <= len(few) <= SETTINGS.course.refined_if_sure
    assert len(few) < len(many) <= SETTINGS.course.refined


def test_a_hopeless_kernel_loses_to_a_hopeful_one(ended, shaken) -> None:
    course = Course(shaken.pyramid, (True, True, True), None, any_focal=False, run=Run())
    kernel = ended.winner.kernel
    course.entries = [ended.winner._replace(start=n) for n in range(4)]

    def end(kernel: RotationKernel) -> Finish:
        return course.finished(ended.winner._replace(kernel=kernel))

    true, turned = end(kernel), end(replace(kernel, theta=3 * kernel.theta[:, [1, 0, 2]]))
    assert confidence(turned) < SETTINGS.course.hopeful
    assert selected([turned, true]) is true
    thick = end(kernel.resampled(2 * kernel.steps))
    assert SETTINGS.course.hopeful <= confidence(thick) < confidence(true)
    assert selected([thick, true]) is thick


def test_the_judge_that_preferred_a_kernel_says_what_it_is_worth(ended, shaken) -> None:
    course = Course(shaken.pyramid, (True, True, True), None, any_focal=False, run=Run())
    course.entries = [ended.winner]
    coarser = Judge.of(shaken.pyramid, 3, [ended.winner.kernel])
    usual, other = course.finished(ended.winner), course.finished(ended.winner, coarser)
    assert other.margin == ended.winner.margin(coarser)
    assert usual.margin == ended.winner.margin(course.comparison.judge(ended.winner))
    assert other == usual._replace(margin=other.margin)
    assert other.margin != usual.margin


def test_the_race_ends_with_the_judge_of_the_polish(photo, monkeypatch) -> None:
    judges: list[Judge] = []

    def coarser(*arguments: Any) -> list[Polished]:
        polish = polished(*arguments)
        judges.append(Judge.of(photo.pyramid, 3, [one.entry.kernel for one in polish]))
        return [one._replace(judge=judges[0]) for one in polish]

    monkeypatch.setattr("deshake.blind.course.polished", coarser)
    course = begun(photo.pyramid)
    ended = course.finish(Run(1))
    assert ended.margin == ended.winner.margin(judges[0])
    assert ended.margin != ended.winner.margin(course.comparison.judge(ended.winner))


def test_spectral_starts_keep_a_bound(larger, spectral) -> None:
    widths = [entry.kernel.extent_px() for entry in spectral[::2]]
    bound = float(np.mean(widths))
    bounded = Course(larger, (True, True, True), bound, any_focal=False, run=Run())
    within = bounded.start_spectral(SETTINGS.spectral_start.usual, Run(1))
    assert max(widths) > bound
    assert within
    assert all(entry.kernel.extent_px() <= bound for entry in within[::2])


def test_a_course_adopts_the_best_kernels_of_another(larger, spectral, ended) -> None:
    course, other = (
        Course(larger, (True, True, True), None, any_focal=False, run=Run(1)) for _ in range(2)
    )
    course.entries = list(spectral)
    other.leaders = [ended.winner._replace(start=3, kernel=spectral[0].kernel)]
    other.ends = [other.leaders[0]._replace(name="end"), spectral[1]]
    course.adopt(other)
    assert course.entries == [*spectral, other.ends[0], *other.leaders]
    assert course.ends == [other.ends[0]]
    assert other.leaders[0].start in {entry.start for entry in course.leaders}
