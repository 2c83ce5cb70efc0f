"""The race: kernels from several starts; the best are refined, and one is kept (`course`).

A camera may have given the photo a tone curve. Then the starts do not run in the light of the file
but in that before a curve of half the usual strength. This light is never far from the right one,
whether there was a curve or not. Where there is little evidence of a shake, the starts run in the
light of the file: a race may stop early there, and its limits were found in that light. The best
kernel of the starts may tell which light is right: the race goes on there (`tones`). The blur may
also suit display values better. So the starts of edges and those of very wide shakes may run there,
too, and the race goes on in the tones that suit the best kernel. If its end is undecided, or if
only the starts in the other tones are trusted, it goes on there, too. Only then do the starts that
the spectra give run in display values.

The race stops early in three cases. The two finest starts run first; if both end in a small round
spot, the photo was not shaken. If the blur of the photo hardly depends on the direction
(`blur_kind`), and if the first kernels have very low confidences, it was not shaken, either, and no
other start runs. And if the confidence of the best kernels of all starts is very low, no refinement
raises it enough.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from deshake.blind.course import Course, first_scales
from deshake.blind.entry import last_of_starts
from deshake.blind.finish import Finish
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.settings import SETTINGS
from deshake.blind.spot import is_spot
from deshake.blind.tones import gains_in_display_values, suited_light
from deshake.blind.trust import confidence
from deshake.geometry.kernel import ALL_AXES
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.candidate import Axes
    from deshake.signal.pyramid import LightBefore, Pyramid

__all__ = ["race"]

_S: Final = SETTINGS.race


def race(
    pyramid: Pyramid,
    *,
    axes: Axes = ALL_AXES,
    bound: float | None = None,
    quick: bool = False,
    may_rest: bool = True,
    any_focal: bool = False,
    before_curve: LightBefore | None = None,
    toned: bool = False,
    evidence: float = math.inf,
    hardly_shaken: bool = False,
    hopeful: float = SETTINGS.course.hopeful,
    run: Run = Run(),
) -> Finish:
    """Estimate a kernel from several first scales, and keep the best.

    Parameters
    ----------
    pyramid : Pyramid
        The photo, in linear light.
    axes : three bools
        The axes that the camera may turn about.
    bound : float, optional
        Largest extent of the kernel in pixels of the photo.
    quick : bool
        Whether to return the best kernel of the starts without any refinement.
    may_rest : bool
        Whether the race may stop early if the finest starts end in a spot. A wide shake may end in
        a spot, too. So this is only safe if the photo looks fairly sharp.
    any_focal : bool
        Whether the focal length of the camera is only assumed. Then it is estimated, too.
    before_curve : callable, optional
        Returns the light before a tone curve of some strength, if the photo may have one.
    toned : bool
        Whether the blur may suit display values better than light. Then the starts may run there,
        too, if there is evidence of a shake.
    evidence : float
        Evidence that the photo is shaken: `Measures.certain_evidence` of `blur_kind`.
    hardly_shaken : bool
        Whether the evidence is little: `Measures.hardly_shaken`. Then the race ends after the two
        finest starts, unless the spectra of the photo match their best kernel, or its direction
        matters.
    hopeful : float
        Confidence of the best kernels of the starts from which they are refined. If it is 0, a
        path is searched for along any winner.
    run : Run, optional
        Threads to use, and who receives the progress.

    """
    shaken = evidence >= _S.little_evidence
    toned = toned and shaken  # others would take twice as long
    lights = (pyramid,) if before_curve is None else _lights(pyramid, before_curve)
    first = lights[1] if shaken and len(lights) > 1 else pyramid
    if first is not pyramid:
        pyramid.forget()  # one of them at most has its scales in memory
    course = Course(first, axes, bound, any_focal=any_focal, toned=toned, run=run.silent())
    starts = first_scales(pyramid.coarsest)
    begun = run.part(0.0, 0.35)
    ended = _begun(
        course,
        starts,
        begun,
        quick=quick,
        may_rest=may_rest,
        evidence=evidence,
        hardly_shaken=hardly_shaken,
    )
    if ended is not None:
        run.report(1.0, "the photo is not shaken")
        return ended
    if not quick:
        course.begin_others(run.part(0.35, 0.45))
        if len(lights) > 1:
            course = _in_suited_light(course, lights)
    courses = [course]
    if toned:
        courses = _in_both_tones(course, starts, quick=quick, run=run.part(0.45, 0.6))
    finish = _ended(courses, hopeful, quick=quick, run=run.part(0.6, 1.0))
    run.report(1.0, "kernel estimated")
    return finish


def _lights(pyramid: Pyramid, before_curve: LightBefore) -> tuple[Pyramid, ...]:
    """Return a photo in the light of its file, and before half and all of a camera's tone curve."""

    def before(strength: float) -> Pyramid:
        return pyramid.in_tones(lambda light: before_curve(light, strength))

    return pyramid, before(_S.of_starts), before(_S.of_camera)


def _in_suited_light(course: Course, lights: Sequence[Pyramid]) -> Course:
    """Go on in the light that suits the best kernel of the starts, which ran in one of them."""
    begun = course.comparison
    compared = [
        begun if light is begun.pyramid else Comparison(light, begun.run) for light in lights
    ]
    suited = suited_light(compared, course.leaders[0])
    return course if suited is begun else course.continued_in(suited)


def _begun(
    course: Course,
    starts: Sequence[int],
    run: Run,
    *,
    quick: bool,
    may_rest: bool,
    evidence: float,
    hardly_shaken: bool,
) -> Finish | None:
    """Run the starts of edges; return the end of the race, if the photo is not shaken."""
    course.start(starts[:2], run.part(0.0, 0.3))
    ends = last_of_starts(course.entries)
    if may_rest and all(is_spot(entry.kernel) and entry.level == 0 for entry in ends):
        return Finish(ends[0], 0.0, 0.0, 1.0, at_rest=True)
    if hardly_shaken:
        best, comparison = course.best_begun(), course.comparison
        if comparison.match(best) < _S.least_match:
            gain = comparison.gain_over_turned(best)
            if gain is None or gain < _S.least_gain:
                return course.finished(best)
    course.begin(starts[2:], run.part(0.3, 1.0), quick=quick)
    if evidence < _S.little_evidence:
        ended = course.finished(course.leaders[0])
        if confidence(ended) < _S.vain:
            return ended
    return None


def _in_both_tones(course: Course, starts: Sequence[int], run: Run, *, quick: bool) -> list[Course]:
    """Return a course and the one in display values, the one with the better starts first.

    There is only the first if its best kernel is beyond doubt, and display values explain it worse.
    If it is trusted, a kernel of a very wide shake may show that display values are better.
    """
    course.pyramid.forget()  # at most one course has its scales in memory
    shown = course.in_display_values()
    leader, score = course.leaders[0], course.score(course.leaders)
    worse = shown.score(course.leaders) < score - _S.display_doubt
    worse |= shown.comparison.match(leader) < course.comparison.match(leader) - _S.match_doubt
    in_light = worse and course.confidence(leader) >= SETTINGS.estimate.even
    if in_light and (course.sure or quick):
        return [course]
    if not quick:
        least = course.comparison.match(leader) if in_light else -1.0
        shown.begin_wide(run.part(0.0, 0.2), least)
    if in_light and not (shown.leaders and _is_better(shown, course.comparison, score)):
        return [course]
    shown.begin(starts, run.part(0.2, 1.0), quick=quick)
    shown.adopt(course)
    better = _is_better(shown, course.comparison, score)
    courses = [shown, course] if better else [course, shown]
    courses[1].pyramid.forget()
    return courses


def _is_better(shown: Course, light: Comparison, score: float) -> bool:
    """Return whether the best kernel suits display values, and exceeds a score in the light."""
    best = shown.leaders[0]
    return shown.score([best]) > score + _S.display_worth and gains_in_display_values(
        _in_linear_light(light), shown.comparison, best
    )


def _in_linear_light(comparison: Comparison) -> Comparison:
    """Return a comparison in the light of the file, to which the gain in display values refers."""
    pyramid = comparison.pyramid
    if pyramid.tones == "linear light":
        return comparison
    return Comparison(pyramid.in_tones(None), comparison.run)


def _ended(courses: Sequence[Course], hopeful: float, run: Run, *, quick: bool) -> Finish:
    """Return the end of the first course; if it is undecided, that of another that is trusted.

    If the first gives no hope from the beginning, another that does may end, too. So may another
    whose starts are trusted, if those of the first are not; the more confident end counts. A path
    is searched for along the winner, unless the photo stays as it is.
    """
    last, first = courses[0], courses[0].comparison
    if quick:
        return last.finished(last.best())
    score = last.score(last.leaders)
    hope, even = SETTINGS.course.hopeful, SETTINGS.estimate.even
    begun, trusted = last.gives_hope(hope), last.gives_hope(even)
    finish = last.end(hopeful, run.part(0.0, 0.5))
    undecided = hope <= confidence(finish) < even
    others = [
        other
        for other in courses[1:]
        if undecided
        or (not begun and other.gives_hope(hope))
        or (not trusted and other.gives_hope(even))
    ]
    if others:
        courses[0].pyramid.forget()
    for other in others:
        least = _S.second
        if other.pyramid.is_displayed:
            other.begin_spectral(run.part(0.5, 0.6))
            if _is_better(other, first, score):
                least = even
        second = other.end(hopeful, run.part(0.6, 0.8))
        if confidence(second) >= max(least, confidence(finish)):
            last, finish = other, second
    end = run.part(0.8, 1.0)
    if last.comparison.is_wide(finish.winner):
        return _on_frame(last, finish, end) if confidence(finish) >= min(hope, hopeful) else finish
    kept = confidence(finish) >= (even if hopeful else 0)
    return last.searched(finish, end) if kept else finish


def _on_frame(course: Course, finish: Finish, run: Run) -> Finish:
    """Refine a winner that is wide for the frame once more, in the tones that suit it.

    The new kernel counts if it is trusted.
    """
    if course.toned and not course.pyramid.is_displayed:
        shown = course.continued_in_display_values()
        # on tiles for this kernel alone, as in the restoration
        light = Comparison(course.pyramid.in_tones(None), shown.comparison.run)
        if gains_in_display_values(light, shown.comparison, finish.winner):
            course.pyramid.forget()
            course = shown
    better = course.polished_on_frame(finish, run)
    even = SETTINGS.estimate.even
    trusted = confidence(better) >= (even if confidence(finish) >= even else _S.second)
    return better if trusted else finish
