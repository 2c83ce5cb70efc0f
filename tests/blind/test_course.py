from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.course import Course, _of_edges, first_scales
from deshake.blind.entry import Entry
from deshake.blind.judge import Judge
from deshake.blind.polish import Polished, polished
from deshake.blind.settings import SETTINGS
from deshake.blind.spot import is_spot
from deshake.blind.trust import confidence, selected
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.run import Run

if TYPE_CHECKING:
    from deshake.blind.candidate import Axes
    from deshake.blind.finish import Finish
    from deshake.blind.kernel_comparison import Comparison
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
        assert all(agreement(kernel, other) < SETTINGS.spectral_start.alike for other in firsts[:n])
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


@pytest.fixture(scope="module")
def wider(shake):
    """A photo of 330 x 440 pixels, which is not tiny."""
    path = np.array([[0.0, -8, -3], [3, -2, 0], [-1, 3, 1], [2, 9, 3]])
    return shake(Camera.from_focal(440.0, 330, 440), path=path)


def test_a_start_of_edges_beyond_doubt_needs_no_others(wider) -> None:
    photo = wider
    assert min(photo.camera.shape) > SETTINGS.course.tiny
    course = begun(photo.pyramid)
    assert course.sure
    assert course.confidence(course.leaders[0]) >= SETTINGS.estimate.doubtful
    assert all(entry.start >= 0 for entry in course.entries)
    assert sorted(end.start for end in course.ends) == first_scales(photo.pyramid.coarsest)
    assert {path.name for path in course.entries if path.name.endswith("path")} == {
        f"{end.name}, path" for end in course.ends if not is_spot(end.kernel)
    }


def test_beyond_doubt_wide_starts_take_part_if_one_of_them_is_better(wider, monkeypatch) -> None:
    true = Entry("true", -3, 0, wider.kernel)
    rough = Entry("rough", 2, 0, replace(wider.kernel, theta=0.6 * wider.kernel.theta))
    point = true._replace(kernel=RotationKernel.delta(wider.camera))
    course = Course(wider.pyramid, (True, True, True), None, any_focal=False, run=Run(1))
    course.entries, course.ends, course.leaders = [rough], [rough], [rough]
    shares: list[float] = []
    narrows: list[Entry | None] = []

    def begin_wide(rival: Entry) -> None:
        def wide(
            _: Course, __: Run, least: float, narrow: Entry | None
        ) -> tuple[list[Entry], list[Entry]]:
            shares.append(least)
            narrows.append(narrow)
            return [rival], [rival._replace(name="path")]

        monkeypatch.setattr(Course, "_wide", wide)
        course.begin_wide(Run(1))

    monkeypatch.setattr(Course, "sure", property(lambda _: True))
    begin_wide(point)
    assert course.entries == course.ends == course.leaders == [rough]
    begin_wide(true)
    assert course.leaders[0].start == true.start
    assert {rough, true} < set(course.entries)
    assert [end.start for end in course.ends] == [rough.start, true.start]
    assert "refined" in course.ends[1].name
    assert shares == pytest.approx([0.8 * course.comparison.match(rough)] * 2)
    monkeypatch.setattr(Course, "sure", property(lambda _: False))
    last = true._replace(start=-4)
    begin_wide(last)
    assert shares[-1] == -1
    assert narrows == [rough, rough, None]
    assert course.ends[2] == last
    assert sum("refined" in entry.name for entry in course.entries if entry.start == -4) == 1


def test_wide_starts_match_enough_and_may_have_to_be_much_wider(shake) -> None:
    path = np.array([[-6.0, -9.6, 0], [-6.0, 4.0, 0], [-2.0, 8.0, 0], [8.0, 9.6, 0]])
    photo = shake(Camera.from_focal(240.0, 200, 240), path=3 * path)  # 57 px
    course = Course(photo.pyramid, (True, True, True), None, any_focal=False, run=Run(1))
    known, paths = course._wide(Run(1), -1.0, None)
    assert len({entry.start for entry in known}) == SETTINGS.course.wide
    assert [entry.start for entry in known] == [entry.start for entry in paths]
    narrow = known[0]._replace(kernel=replace(photo.kernel, theta=photo.kernel.theta / 8))
    wide, _ = course._wide(Run(1), -1.0, narrow)
    assert wide
    assert all(course.comparison.is_much_wider(entry, narrow) for entry in wide)
    assert course._wide(Run(1), -1.0, wide[0]) == ([], [])
    matches = [course.comparison.match(entry) for entry in paths]
    assert matches == sorted(matches, reverse=True)
    enough, _ = course._wide(Run(1), matches[1], None)
    assert [entry.start for entry in enough] == [entry.start for entry in known[:2]]
    assert course._wide(Run(1), 1.0, None) == ([], [])


def test_in_a_tiny_photo_wide_starts_always_take_part(photo) -> None:
    assert min(photo.camera.shape) <= SETTINGS.course.tiny
    course = begun(photo.pyramid)
    assert course.sure
    wide = [entry for entry in course.entries if entry.start < 0]
    assert wide
    assert all(entry.name.startswith("wide start") for entry in wide)
    kept = {entry.start for entry in wide}
    assert len(kept) <= SETTINGS.course.wide
    assert kept < {end.start for end in course.ends}
    for start in kept:
        own = [entry.name for entry in wide if entry.start == start]
        assert sum("refined" in name for name in own) >= 2  # the path and the kernel


@pytest.mark.parametrize(("name", "lines"), [("photo", 2), ("wider", 1)])
def test_the_kernels_of_a_tiny_photo_are_polished_as_if_in_doubt(
    request, monkeypatch, name, lines
) -> None:
    counts: list[int] = []

    def counted(comparison: Any, best: list[Entry], *arguments: Any) -> list[Polished]:
        counts.append(len(best))
        return polished(comparison, best, *arguments)

    monkeypatch.setattr("deshake.blind.course.polished", counted)
    # a kernel that grows would be polished alone
    monkeypatch.setattr("deshake.blind.course.grown", lambda _, entry, *__, **___: entry)
    course = begun(request.getfixturevalue(name).pyramid)
    assert course.sure
    course.finish(Run(1))
    assert counts == [lines]


@pytest.mark.parametrize("grows", [True, False])
def test_a_kernel_that_grows_is_polished_alone(photo, monkeypatch, grows) -> None:
    grown: list[tuple[Entry, bool]] = []
    taken: list[list[Entry]] = []

    def grow(_: Comparison, entry: Entry, __: Axes, bound: float | None, *, toned: bool) -> Entry:
        assert bound == 77
        grown.append((entry, toned))
        return entry._replace(name="grown") if grows else entry

    def polish(comparison: Comparison, best: list[Entry], *arguments: Any) -> list[Polished]:
        taken.append(best)
        return polished(comparison, best, *arguments)

    monkeypatch.setattr("deshake.blind.course.grown", grow)
    monkeypatch.setattr("deshake.blind.course.polished", polish)
    course = begun(photo.pyramid)
    course.toned, course.bound = True, 77.0
    course.finish(Run(1))
    (leader, toned), (best, *others) = grown[0], taken[0]
    assert toned
    assert best == (leader._replace(name="grown") if grows else leader)
    assert len(others) == (0 if grows else 1)


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

    course = begun(photo.pyramid)
    leaders = {leader.start for leader in course.leaders}
    few = refined(course)
    monkeypatch.setattr(Course, "sure", property(lambda _: False))
    many = refined(begun(photo.pyramid))
    assert 1 <= len(few) <= SETTINGS.course.refined_if_sure
    assert few < many <= leaders
    assert len(few) < len(many) == SETTINGS.course.refined


def test_wide_starts_push_no_others_out_of_the_refinement(photo, monkeypatch) -> None:
    scores = {5: 0.9, -1: 0.8, 3: 0.7, -2: 0.6, -3: 0.5, -100: 0.4, 7: 0.3, 9: 0.2}
    course = Course(photo.pyramid, (True, True, True), None, any_focal=False, run=Run(1))
    course.entries = [ONE._replace(start=start) for start in scores]
    monkeypatch.setattr(
        course.comparison, "scores", lambda ones: np.array([scores[one.start] for one in ones])
    )
    monkeypatch.setattr(course.comparison, "foremost", list)
    assert SETTINGS.course.refined == 4
    assert [leader.start for leader in course._leaders()] == [5, -1, 3, -2, -100, 7]


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


def test_a_path_that_is_searched_for_wins_if_it_is_better(ended, shaken, monkeypatch) -> None:
    narrow = replace(SETTINGS.kernel_comparison, narrowest=4.0)  # the kernel is 7.5 px wide
    monkeypatch.setattr("deshake.blind.kernel_comparison._S", narrow)
    monkeypatch.setattr("deshake.blind.narrowing._S", replace(SETTINGS.narrowing, shares=()))
    course = Course(shaken.pyramid, (True, True, True), None, any_focal=False, run=Run())
    course.entries = [ended.winner]
    shorter = replace(ended.winner.kernel, theta=0.85 * ended.winner.kernel.theta)
    short = course.finished(ended.winner._replace(kernel=shorter))
    monkeypatch.setattr(
        "deshake.blind.kernel_comparison.searched", lambda *_, **__: ended.winner.kernel
    )
    found = course.searched(short, Run(1))
    assert found.winner.kernel is ended.winner.kernel
    assert found[1:] == short[1:]  # the path is fitted to the tiles that measure these
    monkeypatch.setattr("deshake.blind.kernel_comparison.searched", lambda *_, **__: shorter)
    assert course.searched(found, Run(1)) == found


def test_the_winner_becomes_narrower_after_the_search(ended, shaken, monkeypatch) -> None:
    for step in ("narrowed", "searched"):
        monkeypatch.setattr(
            f"deshake.blind.course.Comparison.{step}",
            lambda _self, entry, _run, step=step: entry._replace(name=f"{entry.name}, {step}"),
        )
    course = Course(shaken.pyramid, (True, True, True), None, any_focal=False, run=Run())
    found = course.searched(ended, Run(1))
    assert found.winner.name == f"{ended.winner.name}, searched, narrowed"
    assert found[1:] == ended[1:]


def test_a_winner_that_is_refined_on_the_frame_is_worth_what_it_is_within_a_bound(
    ended, shaken, monkeypatch
) -> None:
    course = Course(shaken.pyramid, (True, True, True), None, any_focal=False, run=Run())
    course.entries = [ended.winner]
    true = ended.winner.kernel
    short = course.finished(ended.winner._replace(kernel=replace(true, theta=0.7 * true.theta)))
    asked: list[Axes] = []

    def refined(_: Comparison, entry: Entry, axes: Axes, __: Run) -> Entry:
        asked.append(axes)
        return entry._replace(kernel=true)

    monkeypatch.setattr("deshake.blind.course.polished_on_frame", refined)
    found = course.polished_on_frame(short, Run(1))
    assert asked == [(True, True, short.winner.rolls)]
    best = short.winner._replace(kernel=true)
    assert found == course.finished(best)._replace(lead=course.comparison.lead(best))
    assert found.lead is not None
    assert confidence(found) > confidence(short)
    course.bound = 0.9 * true.extent_px()
    assert course.polished_on_frame(short, Run(1)) is short
    monkeypatch.setattr("deshake.blind.course.polished_on_frame", lambda *_: short.winner)
    course.bound = None
    assert course.polished_on_frame(short, Run(1)) is short


def test_a_course_continues_in_display_values_with_its_kernels(larger, spectral) -> None:
    course = Course(larger, (True, False, True), 50.0, any_focal=True, toned=True, run=Run(1))
    course.entries, course.zoom = list(spectral), 1.5
    shown = course.continued_in_display_values()
    assert shown.pyramid.is_displayed
    assert shown.comparison.pyramid is shown.pyramid
    assert (shown.entries, shown.zoom) == (course.entries, 1.5)
    assert (shown.axes, shown.bound, shown.toned) == (course.axes, 50.0, True)
    assert shown.finished(spectral[0]).zoom == 1.5


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
