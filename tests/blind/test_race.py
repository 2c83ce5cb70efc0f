from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.course import Course, first_scales
from deshake.blind.entry import Entry
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.race import (
    _ended,
    _in_both_tones,
    _in_linear_light,
    _in_suited_light,
    _lights,
    race,
)
from deshake.blind.settings import SETTINGS
from deshake.blind.spot import is_spot
from deshake.blind.trust import confidence
from deshake.formats.camera_curve import light_before, light_behind
from deshake.geometry.camera import Camera
from deshake.run import Run
from deshake.signal.pyramid import Pyramid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.finish import Finish
    from deshake.geometry.kernel import RotationKernel

pytestmark = pytest.mark.long


def test_a_known_shake_wins(ended, shaken) -> None:
    assert agreement(ended.winner.kernel, shaken.kernel) > 0.9
    assert ended.winner.kernel.camera is shaken.camera
    assert not ended.at_rest


def test_the_margin_and_the_agreement_of_a_winner_are_high(ended) -> None:
    assert ended.margin > 0.05
    assert 0.8 < ended.agreement <= 1 + 1e-6


def test_the_kernel_of_a_shake_has_a_lead(ended) -> None:
    assert ended.lead > SETTINGS.trust.usual_lead
    assert confidence(ended) > confidence(ended._replace(lead=None))


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
def test_a_blur_of_display_values_is_found_in_them(photo, ran, quick) -> None:
    light = Pyramid(np.square(np.clip(photo.grey, 0, 1)), photo.camera)
    found = race(light, toned=True, quick=quick)
    assert found.tones == "display values"
    starts = first_scales(light.coarsest)
    assert ran == (starts * 2 if quick else [*starts, "others", *starts])
    assert agreement(found.winner.kernel, photo.kernel) > 0.9
    assert race(light, quick=True).tones == "linear light"
    little = SETTINGS.race.little_evidence
    dim = race(light, toned=True, quick=True, evidence=little - 0.01)
    assert dim.tones == "linear light"


def test_a_blur_of_light_is_found_in_light(shaken, ended, monkeypatch) -> None:
    # a toned race also grows kernels in the other tones
    monkeypatch.setattr("deshake.blind.course.grown", lambda _, entry, *__, **___: entry)
    found = race(shaken.pyramid, toned=True)
    assert found.tones == "linear light"
    assert found.winner.kernel.weights.tobytes() == ended.winner.kernel.weights.tobytes()
    assert found[1:] == ended[1:]


class EndedCourse:
    """A course whose end is known. It says what the race asks of it."""

    leaders = (None,)

    def __init__(
        self,
        ran: list[Finish | str],
        pyramid: Pyramid,
        finish: Finish,
        score: float = 0.0,
        *,
        hope: bool = True,
        trust: bool = True,
    ) -> None:
        self.ran = ran
        self.finish = finish
        self.highest = score
        self.hope = {SETTINGS.course.hopeful: hope, SETTINGS.estimate.even: hope and trust}
        self.pyramid = pyramid.displayed() if finish.tones == "display values" else pyramid
        self.comparison = Comparison(self.pyramid)

    def score(self, _: Sequence[Entry | None]) -> float:
        return self.highest

    def gives_hope(self, least: float) -> bool:
        return self.hope[least]

    def begin_spectral(self, _: Run) -> None:
        self.ran.append("spectral")

    def finished(self, *_: object) -> Finish:
        self.ran.append(self.finish)
        return self.finish

    end = finished
    best = staticmethod(lambda: None)

    def searched(self, finish: Finish, _: Run) -> Finish:
        assert finish is self.finish  # the course of the kernel searches
        self.ran.append("searched")
        return finish


@pytest.fixture
def trusted(ended) -> Finish:
    return ended._replace(margin=0.1, match=0.3, agreement=0.98, tones="display values")


def test_another_course_ends_only_where_the_first_is_undecided(
    ended, trusted, pyramid, monkeypatch
) -> None:
    undecided = ended._replace(margin=0.0, match=0.1, agreement=0.96)
    hopeless = ended._replace(margin=-0.2, match=0.0, agreement=0.5)
    assert SETTINGS.course.hopeful < confidence(undecided) < SETTINGS.estimate.even
    assert confidence(hopeless) < SETTINGS.course.hopeful
    ran: list[Finish | str] = []
    course = partial(EndedCourse, ran, pyramid)
    for first, other, kept, then in (
        (undecided, trusted, trusted, ["spectral", trusted, "searched"]),
        (undecided, hopeless, undecided, [hopeless]),
        (trusted, hopeless, trusted, ["searched"]),
        (hopeless, trusted, hopeless, []),
    ):
        ran.clear()
        assert _ended([course(first), course(other)], 0.15, Run(1), quick=False) is kept
        assert ran == [first, *then]
    for hope, kept, then in (
        (True, trusted, ["spectral", trusted, "searched"]),
        (False, hopeless, []),
    ):
        ran.clear()
        courses = [course(hopeless, hope=False), course(trusted, hope=hope)]
        assert _ended(courses, 0.15, Run(1), quick=False) is kept
        assert ran == [hopeless, *then]
    even, second = SETTINGS.estimate.even, SETTINGS.race.second
    doubtful = next(
        end
        for end in (
            trusted._replace(margin=margin, match=0.1) for margin in np.arange(-0.1, 0.1, 1e-3)
        )
        if even <= confidence(end) < second
    )
    monkeypatch.setattr("deshake.blind.race.gains_in_display_values", lambda *_: True)
    for score, kept in ((0.0, undecided), (0.1, doubtful)):  # of the best start in display values
        courses = [course(undecided), course(doubtful, score)]
        assert _ended(courses, 0.15, Run(1), quick=False) is kept
    assert _ended([course(undecided)], 0.15, Run(1), quick=False) is undecided
    ran.clear()
    assert _ended([course(undecided), course(trusted)], 0.15, Run(1), quick=True) is undecided
    assert _ended([course(hopeless)], 0.0, Run(1), quick=False) is hopeless
    assert ran == [undecided, hopeless, "searched"]


def test_another_course_ends_where_it_alone_has_starts_that_are_trusted(trusted, pyramid) -> None:
    fair = trusted._replace(margin=0.0, tones="linear light")
    assert SETTINGS.estimate.doubtful < confidence(fair) < confidence(trusted)
    ran: list[Finish | str] = []
    for first, other, begun, kept, then in (
        (fair, trusted, (False, True), trusted, ["spectral", trusted, "searched"]),
        (fair, trusted, (False, False), fair, ["searched"]),
        (fair, trusted, (True, True), fair, ["searched"]),
        (trusted, fair, (False, True), trusted, [fair, "searched"]),
    ):
        ran.clear()
        courses = [
            EndedCourse(ran, pyramid, one, trust=trust)
            for one, trust in zip((first, other), begun, strict=True)
        ]
        assert _ended(courses, 0.15, Run(1), quick=False) is kept
        assert ran == [first, *then]


@pytest.mark.parametrize(
    "case",
    [
        ("trusted", "better", True),
        ("trusted", "undecided", False),
        ("undecided", "better", True),
        ("undecided", "doubtful", False),
    ],
)
@pytest.mark.parametrize("tones", [(False, True), (True, False), (True, True)])
def test_a_winner_that_is_wide_is_refined_on_the_frame_in_the_tones_that_suit_it(
    ended, pyramid, monkeypatch, case, tones
) -> None:
    (before, after, kept), (toned, gains) = case, tones
    even, second = SETTINGS.estimate.even, SETTINGS.race.second
    known = ended._replace(match=0.1, agreement=0.97)
    worth = [known._replace(margin=margin) for margin in np.arange(-0.3, 0.3, 1e-3)]
    ends = {
        "undecided": next(end for end in worth if 0.3 <= confidence(end) < even),
        "doubtful": next(end for end in worth if even <= confidence(end) < second),
        "trusted": next(end for end in worth if confidence(end) > second),
        "better": worth[-1],
    }
    assert confidence(ends["better"]) > second
    monkeypatch.setattr("deshake.blind.race.gains_in_display_values", lambda *_: gains)
    monkeypatch.setattr(Comparison, "is_wide", lambda *_: True)
    log: list[str] = []

    class Course:
        leaders = (None,)

        def __init__(self, pyramid: Pyramid) -> None:
            self.pyramid, self.toned = pyramid, toned
            self.comparison = Comparison(pyramid)

        def score(self, _: Sequence[Entry | None]) -> float:
            return 0.0

        def gives_hope(self, _: float) -> bool:
            return True

        def end(self, *_: object) -> Finish:
            return ends[before]

        def continued_in_display_values(self) -> Course:
            return Course(self.pyramid.displayed())

        def polished_on_frame(self, finish: Finish, _: Run) -> Finish:
            assert finish is ends[before]
            log.append("display values" if self.pyramid.is_displayed else "light")
            return ends[after]

    found = _ended([Course(pyramid)], 0.15, Run(1), quick=False)
    assert found is ends[after if kept else before]
    assert log == ["display values" if toned and gains else "light"]


@pytest.mark.parametrize(
    ("case", "least", "both"),
    [
        ((0.9, 0.1, 0.25, False), None, False),  # beyond doubt, and worse in display values
        ((0.9, 0.2, 0.23, False), None, False),  # beyond doubt, and matches worse there
        ((0.6, 0.1, 0.25, False), 0.25, False),  # trusted: a very wide shake must be better
        ((0.6, 0.1, 0.25, True), 0.25, True),
        ((0.3, 0.1, 0.25, False), -1.0, True),  # not trusted
        ((0.9, 0.2, 0.25, False), -1.0, True),  # not worse in display values
    ],
)
def test_very_wide_shakes_may_show_that_display_values_are_better(
    pyramid, monkeypatch, case, least, both
) -> None:
    # of the leader; of display values, twice; of very wide shakes
    chance, shown_score, shown_match, better = case
    log: list[str | float] = []

    class Course:
        leaders = ("leader",)
        sure = chance >= SETTINGS.estimate.doubtful

        def __init__(self, score: float, match: float) -> None:
            self.best, self.matched = score, match
            self.pyramid, self.comparison = pyramid, self

        def in_display_values(self) -> Course:
            return Course(shown_score, shown_match)

        def match(self, _: str) -> float:
            return self.matched

        def score(self, _: Sequence[str]) -> float:
            return self.best

        def confidence(self, _: str) -> float:
            return chance

        def begin_wide(self, _: Run, least_match: float) -> None:
            log.append(least_match)

        def begin(self, _: Sequence[int], __: Run, *, quick: bool) -> None:
            log.append("edges" if not quick else "quick")

        def adopt(self, _: Course) -> None:
            log.append("adopted")

    monkeypatch.setattr("deshake.blind.race._is_better", lambda *_: better)
    courses = _in_both_tones(Course(0.2, 0.25), [1], Run(1), quick=False)
    assert len(courses) == 1 + both
    expected = [] if least is None else [least]
    assert log == expected + ["edges", "adopted"] * both


def test_it_stops_early_for_a_sharp_photo(still) -> None:
    ended = race(still)
    assert ended.at_rest
    assert is_spot(ended.winner.kernel)


def test_it_stops_after_the_starts_if_none_of_them_is_hopeful(grainy, shaken) -> None:
    steps: dict[bool, set[str]] = {False: set(), True: set()}
    ends = {
        blurred: race(
            shaken.pyramid if blurred else grainy,
            may_rest=False,
            run=Run(1, lambda _, text, said=said: said.add(text.split(",")[0])),
        )
        for blurred, said in steps.items()
    }
    assert steps[True] - steps[False] == {"refinement", "search of the path"}
    refined = race(grainy, may_rest=False, hopeful=0.0, run=Run(1))
    assert any(entry in refined.winner.name for entry in ("refined", "polished", "path"))
    assert confidence(ends[False]) < SETTINGS.course.hopeful
    assert not ends[False].at_rest
    assert confidence(ends[True]) > 0.9


def test_a_photo_that_is_hardly_shaken_needs_the_two_finest_starts(soft, ran) -> None:
    ended = race(soft, may_rest=False, hardly_shaken=True)
    assert ran == first_scales(soft.coarsest)[:2]
    assert ended.match < SETTINGS.race.least_match


@pytest.mark.parametrize("much", [False, True])
def test_the_starts_run_in_the_light_of_the_file_if_there_is_little_evidence(
    soft, monkeypatch, much
) -> None:
    begun = []

    class Watched(Course):
        def start(self, scales: list[int], run: Run) -> None:
            begun.append(self.pyramid.tones)
            super().start(scales, run)

    monkeypatch.setattr("deshake.blind.race.Course", Watched)
    evidence = SETTINGS.race.little_evidence + (0.01 if much else -0.01)
    race(soft, quick=True, may_rest=False, before_curve=light_before, evidence=evidence)
    half = _lights(soft, light_before)[1].tones
    assert half != soft.tones
    assert set(begun) == {half if much else soft.tones}


@pytest.mark.parametrize("changed", ["least_match", "least_gain"])
def test_a_match_or_a_gain_is_enough_to_go_on(soft, ran, monkeypatch, changed) -> None:
    least = replace(SETTINGS.race, **{changed: -1.0})
    monkeypatch.setattr("deshake.blind.race._S", least)
    race(soft, may_rest=False, hardly_shaken=True)
    assert ran[: len(first_scales(soft.coarsest))] == first_scales(soft.coarsest)


@pytest.mark.parametrize("quick", [False, True])
def test_a_photo_that_does_not_look_shaken_needs_few_starts(grainy, ran, quick) -> None:
    scales = first_scales(grainy.coarsest)
    little = SETTINGS.race.little_evidence
    for evidence, expected in ((little - 0.01, scales), (1.0, [*scales, "others"])):
        ran.clear()
        ended = race(grainy, may_rest=False, quick=quick, evidence=evidence)
        assert ran == (scales if quick else expected)
        assert confidence(ended) < 0.15 < SETTINGS.race.vain


def test_a_shake_that_the_first_starts_find_is_no_matter_of_evidence(shaken, ran) -> None:
    ended = race(shaken.pyramid, evidence=0.0, hardly_shaken=True)
    assert ran == [*first_scales(shaken.pyramid.coarsest), "others"]
    assert agreement(ended.winner.kernel, shaken.kernel) > 0.9


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


def test_display_values_are_compared_with_the_light_of_the_file(shaken) -> None:
    light = Comparison(shaken.pyramid)
    assert _in_linear_light(light) is light
    bent = Comparison(shaken.pyramid.in_tones(light_before))
    straight = _in_linear_light(bent)
    assert straight.pyramid.tones == "linear light"
    entry = Entry("true", 1, 0, shaken.kernel)
    assert straight.match(entry) == light.match(entry)
    assert straight.match(entry) != bent.match(entry)


def starts_in(pyramid: Pyramid, kernel: RotationKernel) -> Course:
    course = Course(pyramid, (True, True, False), 70.0, any_focal=True, toned=True, run=Run(1))
    true = Entry("start 2", 2, 0, kernel)
    course.entries, course.ends, course.leaders = [true], [true], [true]
    return course


@pytest.mark.parametrize("in_file", [False, True])
@pytest.mark.parametrize("curved", [False, True])
def test_a_race_goes_on_in_the_light_that_suits_its_starts(photo, curved, in_file) -> None:
    light = np.clip(photo.grey, 0, 1)
    pyramid = Pyramid(light_behind(light) if curved else light, photo.camera)
    lights = file, half, whole = _lights(pyramid, light_before)
    course = starts_in(file if in_file else half, photo.kernel)
    other = _in_suited_light(course, lights)
    assert other.comparison.pyramid is other.pyramid is (whole if curved else pyramid)
    np.testing.assert_allclose(other.pyramid.at(0).picture, light, atol=1e-5)
    assert (other is course) == (in_file and not curved)
    assert (other.axes, other.bound) == ((True, True, False), 70.0)
    assert other.any_focal
    assert other.toned
    assert [entry.kernel for entry in other.leaders] == [photo.kernel]


@pytest.mark.parametrize("in_file", [False, True])
def test_a_race_goes_on_before_half_of_a_curve_where_no_light_suits_its_starts_better(
    photo, in_file
) -> None:
    pyramid = Pyramid(np.clip(photo.grey, 0, 1), photo.camera)
    lights = file, half, _ = _lights(pyramid, lambda light, _: light)
    course = starts_in(file if in_file else half, photo.kernel)
    other = _in_suited_light(course, lights)
    assert other.pyramid is half
    assert (other is course) == (not in_file)
