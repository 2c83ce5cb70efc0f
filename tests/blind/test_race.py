from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.entry import Entry
from deshake.blind.race import _Course, _ended, _first_scales, _of_edges, race
from deshake.blind.settings import SETTINGS
from deshake.blind.spot import is_spot
from deshake.blind.trust import confidence
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.run import Run
from deshake.signal.pyramid import Pyramid

if TYPE_CHECKING:
    from deshake.blind.finish import Finish

pytestmark = pytest.mark.long

ONE = Entry("start 3, scale 0", 3, 0, RotationKernel.delta(Camera.from_focal(64.0, 56, 64)))


def test_a_known_shake_wins(ended, shaken) -> None:
    assert agreement(ended.winner.kernel, shaken.kernel) > 0.9
    assert ended.winner.kernel.camera is shaken.camera
    assert not ended.at_rest


def test_the_margin_and_the_agreement_of_a_winner_are_high(ended) -> None:
    assert ended.margin > 0.05
    assert 0.8 < ended.agreement <= 1 + 1e-6


def test_a_winner_is_centred_and_knows_its_scale(ended, pyramid) -> None:
    winner = ended.winner
    np.testing.assert_allclose(winner.kernel.centroid, 0, atol=1e-3 * winner.kernel.steps.min())
    assert 0 <= winner.level <= pyramid.coarsest
    assert winner.name


def test_progress_rises_to_one(ended, shares) -> None:
    assert not ended.at_rest
    assert shares == sorted(shares)
    assert shares[0] >= 0
    assert shares[-1] == 1
    assert len(set(shares)) > 5


@pytest.fixture(scope="module")
def larger(photo) -> Pyramid:
    return photo.pyramid


@pytest.fixture(scope="module")
def course(larger) -> _Course:
    return _Course(larger, (True, True, True), None, None, any_focal=False, run=Run())


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
        assert all(agreement(kernel, other) < SETTINGS.race.alike for other in firsts[:n])
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
    course = _Course(shaken.pyramid, (True, True, True), None, None, any_focal=False, run=Run())
    course.entries = [ended.winner._replace(start=n) for n in range(4)]
    assert not course.comparison.is_wide(ended.winner)
    assert not course.may_be_wide(ended.winner)


def begun(pyramid: Pyramid) -> _Course:
    """Return a course whose starts have run."""
    course = _Course(pyramid, (True, True, True), None, None, any_focal=False, run=Run(1))
    course.begin(_first_scales(pyramid.coarsest), Run(1), quick=False)
    return course


def test_a_start_of_edges_beyond_doubt_needs_no_others(photo) -> None:
    course = begun(photo.pyramid)
    assert course.sure
    assert course.confidence(course.leaders[0]) >= SETTINGS.estimate.doubtful
    assert all(entry.start >= 0 for entry in course.entries)
    assert sorted(end.start for end in course.ends) == _first_scales(photo.pyramid.coarsest)
    assert {path.name for path in course.entries if path.name.endswith("path")} == {
        f"{end.name}, path" for end in course.ends if not is_spot(end.kernel)
    }


def test_starts_of_edges_in_doubt_are_followed_by_others(still) -> None:
    grain = np.random.default_rng(0).normal(0, 0.1, still.camera.shape)
    grainy = np.clip(still.at(0).picture + grain, 0, 1).astype(np.float32)
    course = begun(Pyramid(grainy, still.camera))
    assert not course.sure
    starts = {end.start for end in course.ends}
    assert any(start < 0 for start in starts)
    assert starts == {entry.start for entry in course.entries}
    assert len(course.ends) == len(starts)


def test_fewer_starts_are_refined_if_one_is_beyond_doubt(photo, monkeypatch) -> None:
    def refined(course: _Course) -> set[int]:
        course.finish(Run(1))
        return {entry.start for entry in course.entries if "refined" in entry.name}

    few = refined(begun(photo.pyramid))
    monkeypatch.setattr(_Course, "sure", property(lambda _: False))
    many = refined(begun(photo.pyramid))
    assert 1 <= len(few) <= SETTINGS.race.refined_if_sure
    assert len(few) < len(many) <= SETTINGS.race.refined


def test_a_hopeless_kernel_loses_to_a_hopeful_one(ended, shaken) -> None:
    course = _Course(shaken.pyramid, (True, True, True), None, None, any_focal=False, run=Run())
    true = ended.winner
    turned = true._replace(kernel=replace(true.kernel, theta=3 * true.kernel.theta[:, [1, 0, 2]]))
    course.entries = [true._replace(start=n) for n in range(4)]
    assert course.confidence(turned) < SETTINGS.race.hopeful
    assert course.selected([turned, true]) is true
    thick = true._replace(kernel=true.kernel.resampled(2 * true.kernel.steps))
    assert SETTINGS.race.hopeful <= course.confidence(thick) < course.confidence(true)
    assert course.selected([thick, true]) is thick


def test_spectral_starts_keep_a_bound(larger, spectral) -> None:
    widths = [entry.kernel.extent_px() for entry in spectral[::2]]
    bound = float(np.mean(widths))
    bounded = _Course(larger, (True, True, True), bound, None, any_focal=False, run=Run())
    within = bounded.start_spectral(SETTINGS.spectral_start.usual, Run(1))
    assert max(widths) > bound
    assert within
    assert all(entry.kernel.extent_px() <= bound for entry in within[::2])


@pytest.mark.parametrize("quick", [False, True])
def test_a_focal_length_that_is_only_assumed_is_estimated(shake, quick) -> None:
    path = np.array([[0.0, -10, -1], [4, -3, 0], [-1, 4, 1], [3, 12, 1]])
    wide = shake(Camera.from_focal(0.65 * np.hypot(240, 320), 240, 320), path=path)
    assumed = wide.pyramid.zoomed(1.8)
    ended = race(assumed, any_focal=True, quick=quick)
    assert 1.8 * ended.zoom == pytest.approx(1, rel=0.3)
    kernel = ended.winner.kernel
    assert kernel.camera.focal_px == pytest.approx(ended.zoom * assumed.camera.focal_px)
    assert agreement(kernel, wide.kernel) > (0.7 if quick else 0.85)


def test_the_uniform_model_has_no_focal_length(shake) -> None:
    pan = shake(Camera.uniform(56, 64), np.array([[0.0, -2, 0], [0, 2, 0]]))
    assert race(pan.pyramid, any_focal=True).zoom == 1


@pytest.mark.parametrize("quick", [False, True])
def test_a_blur_of_display_values_is_found_in_them(photo, quick) -> None:
    light = Pyramid(np.square(np.clip(photo.grey, 0, 1)), photo.camera)
    found = race(light, toned=True, quick=quick)
    assert found.displayed
    assert agreement(found.winner.kernel, photo.kernel) > 0.9
    assert not race(light, quick=True).displayed


def test_a_blur_of_light_is_found_in_light(shaken, ended) -> None:
    found = race(shaken.pyramid, toned=True)
    assert not found.displayed
    assert found.winner.kernel.weights.tobytes() == ended.winner.kernel.weights.tobytes()
    assert found[1:] == ended[1:]


def test_another_course_ends_only_where_the_first_is_undecided(ended, pyramid) -> None:
    undecided = ended._replace(margin=0.0, match=0.1, agreement=0.96)
    trusted = ended._replace(margin=0.1, match=0.3, agreement=0.98, displayed=True)
    hopeless = ended._replace(margin=-0.2, match=0.0, agreement=0.5)
    assert SETTINGS.race.hopeful < confidence(undecided) < SETTINGS.estimate.even
    assert confidence(hopeless) < SETTINGS.race.hopeful
    ran: list[Finish] = []

    class Course:
        def __init__(self, finish: Finish) -> None:
            self.finish = finish
            self.pyramid = pyramid

        def end(self, run: Run, *, quick: bool) -> Finish:  # noqa: ARG002
            ran.append(self.finish)
            return self.finish

    for first, other, kept, both in (
        (undecided, trusted, trusted, True),
        (undecided, hopeless, undecided, True),
        (trusted, hopeless, trusted, False),
        (hopeless, trusted, hopeless, False),
    ):
        ran.clear()
        assert _ended([Course(first), Course(other)], Run(1), quick=False) is kept
        assert ran == ([first, other] if both else [first])
    assert _ended([Course(undecided)], Run(1), quick=False) is undecided
    assert _ended([Course(undecided), Course(trusted)], Run(1), quick=True) is undecided


def test_a_course_adopts_the_best_kernels_of_another(larger, spectral, ended) -> None:
    course, other = (
        _Course(larger, (True, True, True), None, None, any_focal=False, run=Run(1))
        for _ in range(2)
    )
    course.entries = list(spectral)
    other.leaders = [ended.winner._replace(start=3, kernel=spectral[0].kernel)]
    other.ends = [other.leaders[0]._replace(name="end"), spectral[1]]
    course.adopt(other)
    assert course.entries == [*spectral, other.ends[0], *other.leaders]
    assert course.ends == [other.ends[0]]
    assert other.leaders[0].start in {entry.start for entry in course.leaders}


def test_it_stops_early_for_a_sharp_photo(still) -> None:
    ended = race(still)
    assert ended.at_rest
    assert is_spot(ended.winner.kernel)


def test_it_stops_after_the_starts_if_none_of_them_is_hopeful(still, shaken) -> None:
    grain = np.random.default_rng(0).normal(0, 0.1, still.camera.shape)
    grainy = np.clip(still.at(0).picture + grain, 0, 1).astype(np.float32)
    steps: dict[bool, set[str]] = {False: set(), True: set()}
    ends = {
        blurred: race(
            shaken.pyramid if blurred else Pyramid(grainy, still.camera),
            may_rest=False,
            run=Run(1, lambda _, text, said=said: said.add(text.split(",")[0])),
        )
        for blurred, said in steps.items()
    }
    assert steps[True] - steps[False] == {"refinement"}
    assert confidence(ends[False]) < SETTINGS.race.hopeful
    assert not ends[False].at_rest
    assert confidence(ends[True]) > 0.9


def test_a_quick_race_without_roll_and_within_a_bound_on_any_threads(shaken) -> None:
    one, two = (
        race(shaken.pyramid, axes=(True, True, False), bound=2.0, quick=True, run=Run(threads))
        for threads in (1, 2)
    )
    kernel = one.winner.kernel
    assert np.ptp(kernel.theta[:, 2]) < 0.05 * kernel.steps[2]
    assert np.ptp(kernel.theta, axis=0).max() < (2 * 3 + 0.5) * kernel.steps[0]
    assert two.winner.kernel.theta.tobytes() == kernel.theta.tobytes()
    assert two.winner.kernel.weights.tobytes() == kernel.weights.tobytes()
    assert two.winner.name == one.winner.name
    assert two[1:] == one[1:]


def test_a_photo_of_one_scale_has_a_race_of_one(shake) -> None:
    small = shake(Camera.from_focal(64.0, 56, 64), np.array([[0.0, -2, 0], [0, 2, 0]]))
    pyramid = Pyramid(small.grey, small.camera)
    assert pyramid.coarsest == 0
    ended = race(pyramid)
    assert ended.winner.level == 0
    assert ended.winner.kernel.camera is small.camera
