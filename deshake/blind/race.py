"""The race: candidates from several first scales; the best are refined, and one is kept.

An estimate needs a first scale where the shake is a few pixels wide. This scale is unknown. So
candidates start at every second scale (in a small photo, at every scale), and each continues to the
finest scale that it can reach.

The score of the comparison then ranks the kernels, on tiles that no candidate used
(`kernel_comparison`). A smooth path through each kernel is fitted to the spectra of the photo
(`spectral_match`). The best kernels are refined, with roll and without, fitted to the spectra once
more, and ranked again. The best kernels of two starts are polished (`polish`).

Every second start carries its kernel as a thin path from scale to scale. Wide shakes often
succeed in only one of the two ways. If the best kernel of these starts is beyond doubt, no others
run, and fewer kernels are refined. Otherwise very wide shakes have starts of their own
(`wide_start`). Other starts need no latent picture: they are the paths that match the spectra best
(`spectral_start`). The spectra cannot tell a path from its reflection, so both take part.

A camera may have given the photo a tone curve. Then its blur may suit display values better than
linear light (`tones`). So the starts may run there, too, and the race goes on in the tones that
suit the best kernel. If its end is undecided, it goes on in the other tones, too.

The race stops early in two cases. The two finest starts run first; if both end in a small round
spot, the photo was not shaken. And if the confidence of the best kernels of the starts is very low,
no refinement raises it enough.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.agreement import agreement
from deshake.blind.candidate import Axes, Candidate
from deshake.blind.entry import Entry, all_refined, best_of_starts, nearest
from deshake.blind.finish import Finish
from deshake.blind.focal_search import best_zoom
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.polish import polished
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_start import spectral_starts
from deshake.blind.spot import is_spot
from deshake.blind.tones import gains_in_display_values
from deshake.blind.trust import confidence
from deshake.blind.wide_start import wide_starts
from deshake.geometry.kernel import ALL_AXES
from deshake.operators.strips import in_order, reported
from deshake.run import Run
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from deshake.blind.camera_path import SmoothPath
    from deshake.blind.drawn_path import Drawing
    from deshake.blind.settings import PathScales
    from deshake.signal.pyramid import Pyramid

__all__ = ["race"]

_S: Final = SETTINGS.race
_WAYS: Final = (SETTINGS.candidate.fine, SETTINGS.candidate.thin)  # the starts use them in turn
_OF_STREAKS = -1  # number of the start that is no scale
_OF_WIDE = -2  # number of the first wide start; the others count downwards
_OF_SPECTRA = -100  # number of the first spectral start; the others count downwards


def race(
    pyramid: Pyramid,
    *,
    axes: Axes = ALL_AXES,
    bound: float | None = None,
    quick: bool = False,
    may_rest: bool = True,
    drawn: Drawing | None = None,
    any_focal: bool = False,
    toned: bool = False,
    run: Run = Run(),
) -> Finish:
    """Estimate a kernel from several first scales, and keep the best.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    axes : three bools
        The axes that the camera may turn about.
    bound : float, optional
        Largest extent of the kernel in pixels of the photo.
    quick : bool
        Whether to return the best kernel of the starts without any refinement.
    may_rest : bool
        Whether the race may stop early if the finest starts end in a spot. A wide shake may end in
        a spot, too. So this is only safe if the photo looks fairly sharp.
    drawn : Drawing, optional
        What the streaks of lights say of the shake; it takes part in the race.
    any_focal : bool
        Whether the focal length of the camera is only assumed. Then it is estimated, too.
    toned : bool
        Whether the photo may have a tone curve. Then its blur may suit its display values better
        than its light, and the starts may run there, too.
    run : Run, optional
        Threads to use, and who receives the progress.

    """
    course = _Course(pyramid, axes, bound, drawn, any_focal=any_focal, run=run.silent())
    starts = _first_scales(pyramid.coarsest)
    course.start(starts[:2], run.part(0.0, 0.1))
    ends = _last(course.entries)
    if may_rest and all(is_spot(entry.kernel) and entry.level == 0 for entry in ends):
        run.report(1.0, "the photo is not shaken")
        return Finish(ends[0], 0.0, 0.0, 1.0, at_rest=True)
    course.begin(starts[2:], quick=quick, run=run.part(0.1, 0.45))
    courses = [course]
    if toned:
        courses = course.and_in_display_values(starts, quick=quick, run=run.part(0.45, 0.6))
    finish = _ended(courses, quick=quick, run=run.part(0.6, 1.0))
    run.report(1.0, "kernel estimated")
    return finish


def _ended(courses: Sequence[_Course], run: Run, *, quick: bool) -> Finish:
    """Return the end of the first course; if it is undecided, that of another that is trusted."""
    finish = courses[0].end(quick=quick, run=run.part(0.0, 0.75))
    if not quick and _S.hopeful <= confidence(finish) < SETTINGS.estimate.even:
        courses[0].pyramid.forget()
        others = [course.end(quick=quick, run=run.part(0.75, 1.0)) for course in courses[1:]]
        finish = next((other for other in others if confidence(other) >= _S.second), finish)
    return finish


class _Course:
    """The photo, the settings, and the kernels that all steps of a race share."""

    def __init__(
        self,
        pyramid: Pyramid,
        axes: Axes,
        bound: float | None,
        drawn: Drawing | None,
        *,
        any_focal: bool,
        run: Run,
    ) -> None:
        self.pyramid = pyramid
        self.axes = (axes[0], axes[1], axes[2] and not pyramid.camera.is_uniform)
        self.bound = bound
        self.drawn = drawn
        self.comparison = Comparison(pyramid, None if drawn is None else drawn.kernel, run)
        self.any_focal = any_focal and not pyramid.camera.is_uniform
        self.zoom = 1.0
        self.displayed = False
        self.entries: list[Entry] = []
        self.ends: list[Entry] = []
        self.leaders: list[Entry] = []

    def and_in_display_values(
        self, starts: Sequence[int], run: Run, *, quick: bool
    ) -> list[_Course]:
        """Return this course and one in display values, the one with the better starts first.

        There is only this one if its best kernel is trusted, and display values explain it worse.
        """
        self.pyramid.forget()  # at most one course has its scales in memory
        shown = _Course(
            self.pyramid.displayed(),
            self.axes,
            self.bound,
            self.drawn,
            any_focal=self.any_focal,
            run=self.comparison.run,
        )
        score = self.score(self.leaders)
        worse = shown.score(self.leaders) < score - _S.display_doubt
        if worse and self.confidence(self.leaders[0]) >= SETTINGS.estimate.even:
            return [self]
        shown.displayed = True
        shown.begin(starts, run, quick=quick)
        shown.adopt(self)
        best = shown.leaders[0]
        better = shown.score([best]) > score + _S.display_worth and gains_in_display_values(
            self.comparison, shown.comparison, best
        )
        courses = [shown, self] if better else [self, shown]
        courses[1].pyramid.forget()
        return courses

    def end(self, run: Run, *, quick: bool) -> Finish:
        """Refine the best kernels, unless none is hopeful; return what the best one is worth."""
        if quick:
            return self.finished(self.best())
        hopeful = any(self.confidence(leader) >= _S.hopeful for leader in self.leaders)
        return self.finished(self.finish(run) if hopeful else self.leaders[0])

    def adopt(self, other: _Course) -> None:
        """Add the best kernels of another course, and the ends of their starts."""
        best = {entry.start for entry in other.leaders}
        ends = [entry for entry in other.ends if entry.start in best]
        self.entries += [*ends, *other.leaders]
        self.ends = best_of_starts(self._ranked([*self.ends, *ends]))
        self.leaders = self._leaders()

    def begin(self, starts: Sequence[int], run: Run, *, quick: bool) -> None:
        """Run all starts, those of edges at the given scales; find the best kernels of the best.

        With `quick`, only those of edges run.
        """
        self.start(starts, run.part(0.0, 0.6))
        if self.drawn is not None:
            streaks = Entry("streaks", _OF_STREAKS, self.drawn.level, self.drawn.kernel)
            self.entries.append(streaks)
        if quick:
            self.leaders = self._leaders()
            return
        self._end_starts(0)
        if self.sure:
            return
        known = len(self.entries)
        self.start_wide(run.part(0.6, 0.7))
        self.start_spectral(SETTINGS.spectral_start.usual, run.part(0.7, 0.85))
        self._end_starts(known)
        if self.may_be_wide(self.leaders[0]):
            known = len(self.entries)
            self.start_spectral(SETTINGS.spectral_start.wide, run.part(0.85, 1.0))
            self._end_starts(known)

    def score(self, entries: Sequence[Entry]) -> float:
        """Return the highest score of kernels."""
        return float(self.comparison.scores(entries).max())

    def start(self, starts: Sequence[int], run: Run) -> None:
        """Run candidates to their finest scales; keep the kernels of their last scales."""
        for _, new in reported(self._started, starts, run, "starts"):
            self.entries += new

    def start_wide(self, run: Run) -> None:
        """Estimate kernels of very wide shakes; keep those that match the spectra best."""
        starts = [
            Entry(f"wide start {n}, scale {level}", _OF_WIDE - n, level, kernel)
            for n, (level, kernel) in enumerate(wide_starts(self.pyramid, self.axes, run))
            if self.bound is None or kernel.extent_px() <= self.bound
        ]
        wide = [entry for entry in starts if entry.width > _S.least_width * RATIO**entry.level]
        matches = self.comparison.matches(wide)
        self.entries += [wide[n] for n in np.argsort(-matches, kind="stable")[: _S.wide]]

    def start_spectral(self, scales: PathScales, run: Run) -> list[Entry]:
        """Find paths by the spectra; keep and return distinct ones that match best.

        Each is followed by its reflection.
        """
        found = list(self._of_paths(spectral_starts(self.pyramid, self.axes, run, scales)))
        matches = self.comparison.matches([entry for entry, _ in found])
        taken: list[Entry] = []
        for n in np.argsort(-matches, kind="stable"):
            entry, path = found[n]
            if all(agreement(entry.kernel, known.kernel) < _S.alike for known in taken):
                reflected = entry._replace(
                    name=f"{entry.name}, reflected",
                    start=entry.start - 1,
                    kernel=path.reflected.kernel(self.pyramid.camera),
                )
                taken += [entry, reflected]
            if len(taken) == 2 * _S.spectral:
                break
        self.entries += taken
        return taken

    def _of_paths(
        self, starts: Sequence[tuple[int, SmoothPath]]
    ) -> Iterator[tuple[Entry, SmoothPath]]:
        """Make entries of paths, with numbers that leave room for their reflections."""
        lowest = min([_OF_SPECTRA + 1, *(entry.start for entry in self.entries)])
        for n, (level, path) in enumerate(starts):
            kernel = path.kernel(self.pyramid.camera)
            name = f"spectral start {n}, scale {level}"
            entry = Entry(name, lowest - 1 - 2 * n, level, kernel)
            entry = entry._replace(level=min(level, self.comparison.level(entry)))
            if self.bound is None or kernel.extent_px() <= self.bound:
                yield entry, path

    @property
    def sure(self) -> bool:
        """Whether the best kernel of the starts is beyond doubt."""
        return self.confidence(self.leaders[0]) >= SETTINGS.estimate.doubtful

    def may_be_wide(self, leader: Entry) -> bool:
        """Return whether the shake may be wider than most starts can find."""
        wide = self.comparison.is_wide(leader)
        return wide or self.confidence(leader) < SETTINGS.estimate.even

    def confidence(self, winner: Entry) -> float:
        """Return the confidence of a kernel, if it wins."""
        return confidence(self.finished(winner))

    def finished(self, winner: Entry) -> Finish:
        """Return what the confidence of a kernel depends on, if it wins."""
        comparison = self.comparison
        alike = nearest(winner, _of_edges(self.entries))
        if comparison.witness is not None:
            alike = max(alike, agreement(winner.kernel, comparison.witness))
        margin, match = winner.margin(comparison.judge(winner)), comparison.match(winner)
        return Finish(
            winner,
            margin,
            match,
            alike,
            at_rest=False,
            zoom=self.zoom,
            displayed=self.displayed,
        )

    def best(self) -> Entry:
        """Return the best kernel."""
        best = self._ranked(self.entries)[0]
        return best.zoomed(self._focus([best]))

    def _end_starts(self, known: int) -> None:
        """Keep the last kernels of the starts after the known entries, and find the best kernels.

        Smooth paths through those of edges take part.
        """
        new = _last(self.entries[known:])
        self.ends += new
        self.entries += self._matched(_of_edges(new))
        self.leaders = self._leaders()

    def _leaders(self) -> list[Entry]:
        """Return the best kernels of the best starts."""
        return best_of_starts(self._ranked(self.entries))[: _S.refined]

    def finish(self, run: Run) -> Entry:
        """Refine the kernels of the best starts, keep them, too, and return the best kernel.

        If the best of them is beyond doubt, fewer are refined and polished.
        """
        count, lines = (_S.refined_if_sure, 1) if self.sure else (_S.refined, _S.polished)
        leaders = self.leaders[:count]
        starts = {entry.start for entry in leaders}
        ends = _zoomed(self.ends, self._focus(leaders))
        taken = [end for end in ends if end.start in starts]
        taken = [end for end in taken if not is_spot(end.kernel)] or taken
        self.entries += self._refined(taken, run.part(0.0, 0.5))
        best = best_of_starts(self._ranked(self._contenders(starts)))
        self.entries += self._matched(best[:count])
        ranked = self._ranked(self._contenders(starts))
        ratio = self._focus(best_of_starts(ranked)[:lines])
        best = _zoomed(best_of_starts(ranked)[:lines], ratio)
        polish = run.part(0.5, 1.0)
        return self.selected(
            polished(self.comparison, best, _zoomed(ends, ratio), self.axes, polish)
        )

    def selected(self, best: Sequence[Entry]) -> Entry:
        """Return the first kernel, or, if it is hopeless, the one with the highest confidence."""
        hopeful = self.confidence(best[0]) >= _S.hopeful
        return best[0] if hopeful else max(best, key=self.confidence)

    def _focus(self, best: Sequence[Entry]) -> float:
        """Take the focal length that suits the kernels, unless it is known; return the zoom."""
        ratio = best_zoom(self.comparison, best) if self.any_focal else 1.0
        if ratio != 1:
            self.zoom *= ratio
            self.comparison = self.comparison.zoomed(ratio)
            self.pyramid = self.comparison.pyramid
            self.entries = _zoomed(self.entries, ratio)
        return ratio

    def _contenders(self, starts: set[int]) -> list[Entry]:
        """Return the kernels that may win.

        A new focal length needs new scores. Only the best starts are worth their time.
        """
        if self.zoom == 1:
            return self.entries
        return [entry for entry in self.entries if entry.start in starts]

    def _ranked(self, entries: Sequence[Entry]) -> list[Entry]:
        """Sort kernels by their scores, the best first."""
        scores = self.comparison.scores(entries)
        return [entries[i] for i in np.argsort(-scores, kind="stable")]

    def _matched(self, entries: Sequence[Entry]) -> list[Entry]:
        """Fit a smooth path through each kernel to the spectra of the photo."""
        comparison = self.comparison
        blurred = [entry for entry in entries if not is_spot(entry.kernel)]
        return [path for _, path in in_order(comparison.matched, blurred, comparison.run)]

    def _refined(self, entries: Sequence[Entry], run: Run) -> list[Entry]:
        """Refine kernels, with roll and without."""
        uniform = self.pyramid.camera.is_uniform
        ways = (_S.refinement, _S.uniform_refinement) if uniform else (_S.refinement,)
        flat = (self.axes[0], self.axes[1], False)
        all_axes = (self.axes, flat) if self.axes[2] else (self.axes,)
        jobs = [(entry, how, axes) for axes in all_axes for entry in entries for how in ways]
        return all_refined(self.pyramid, jobs, run)

    def _started(self, start: int) -> list[Entry]:
        """Run one start to its finest scale; return the kernels of its last scales."""
        way = _WAYS[start // 2 % len(_WAYS)]
        candidate = Candidate(self.pyramid, start, way, axes=self.axes, bound=self.bound)
        entries = []
        while candidate.advance():
            name = f"start {start}, scale {candidate.level}"
            entries.append(Entry(name, start, candidate.level, candidate.kernel))
        return entries[-_S.snapshots :]


def _first_scales(coarsest: int) -> list[int]:
    """Return the first scales of all starts, the finest first."""
    coarsest = min(coarsest, _S.coarsest_start)
    sparse = list(range(coarsest, 0, -2))[::-1] or [0]
    return sparse if len(sparse) >= _S.fewest_starts else list(range(1, coarsest + 1)) or [0]


def _of_edges(entries: Sequence[Entry]) -> list[Entry]:
    """Return the kernels that edges gave. Those of spectral starts resemble each other."""
    return [entry for entry in entries if entry.start > _OF_SPECTRA]


def _zoomed(entries: Sequence[Entry], ratio: float) -> list[Entry]:
    """Return the kernels for a focal length `ratio` times as long."""
    return [entry.zoomed(ratio) for entry in entries]


def _last(entries: Sequence[Entry]) -> list[Entry]:
    """Return the last kernel of every start."""
    return list({entry.start: entry for entry in entries}.values())
