"""The race: candidates from several first scales; the best are refined, and one is kept.

An estimate needs a first scale where the shake is a few pixels wide. This scale is unknown. So
candidates start at every second scale (in a small photo, at every scale), and each continues to the
finest scale that it can reach.

The score of the comparison then ranks the kernels, on tiles that no candidate used
(`kernel_comparison`). A smooth path through each kernel is fitted to the spectra of the photo
(`spectral_match`). The best kernels are refined, with roll and without, fitted to the spectra once
more, and ranked again. The best kernels of two starts are polished (`polish`).

Every second start carries its kernel as a thin path from scale to scale. Wide shakes often succeed
in only one of the two ways. Very wide ones have starts of their own (`wide_start`). Other starts
need no latent picture: they are the paths that match the spectra best (`spectral_start`). The
spectra cannot tell a path from its reflection, so both take part.

The two finest starts run first. If both end in a small round spot, the photo was not shaken, and
the race stops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from deshake.blind.agreement import agreement
from deshake.blind.candidate import Axes, Candidate
from deshake.blind.entry import Entry, all_refined, best_of_starts, nearest
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.polish import polished
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_start import spectral_starts
from deshake.blind.spot import is_spot
from deshake.blind.wide_start import wide_starts
from deshake.geometry.kernel import ALL_AXES
from deshake.operators.strips import in_order
from deshake.run import Run
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from deshake.blind.camera_path import SmoothPath
    from deshake.blind.drawn_path import Drawing
    from deshake.signal.pyramid import Pyramid

__all__ = ["Finish", "race"]

_S: Final = SETTINGS.race
_WAYS: Final = (SETTINGS.candidate.fine, SETTINGS.candidate.thin)  # the starts use them in turn
_OF_STREAKS = -1  # number of the start that is no scale
_OF_WIDE = -2  # number of the first wide start; the others count downwards
_OF_SPECTRA = -100  # number of the first spectral start; the others count downwards


class Finish(NamedTuple):
    """The result of a race.

    Parameters
    ----------
    winner : Entry
        The best kernel.
    margin : float
        Margin of the winner: its gain in the judge's ``-ln E`` over a still camera.
    match : float
        Correlation of the spectra of the photo with those of the winner, -1..1.
    agreement : float
        Mean agreement of the winner with the nearest kernels of other starts, 0..1.
    at_rest : bool
        Whether the race stopped early, because the winner is a small round spot.

    """

    winner: Entry
    margin: float
    match: float
    agreement: float
    at_rest: bool


def race(
    pyramid: Pyramid,
    *,
    axes: Axes = ALL_AXES,
    bound: float | None = None,
    quick: bool = False,
    may_rest: bool = True,
    drawn: Drawing | None = None,
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
    run : Run, optional
        Threads to use, and who receives the progress.

    """
    course = _Course(pyramid, axes, bound, drawn)
    starts = _first_scales(pyramid.coarsest)
    entries = course.started(starts[:2], run.part(0.0, 0.15))
    if may_rest and all(is_spot(e.kernel) and e.level == 0 for e in _last(entries)):
        run.report(1.0, "the photo is not shaken")
        return Finish(_last(entries)[0], 0.0, 0.0, 1.0, at_rest=True)
    entries += course.started(starts[2:], run.part(0.15, 0.5))
    if drawn is not None:
        entries.append(Entry("streaks", _OF_STREAKS, drawn.level, drawn.kernel))
    if quick:
        winner = course.best(entries)
    else:
        entries += course.wide(run.part(0.5, 0.55))
        entries += course.spectral(run.part(0.55, 0.6))
        winner = course.finished(entries, run.part(0.6, 1.0))
    margin = winner.margin(course.comparison.judge(winner))
    run.report(1.0, "kernel estimated")
    match = course.comparison.match(winner)
    alike = nearest(winner, _of_edges(entries))
    if drawn is not None:
        alike = max(alike, agreement(winner.kernel, drawn.kernel))
    return Finish(winner, margin, match, alike, at_rest=False)


class _Course:
    """The photo and the settings that all steps of a race share."""

    def __init__(
        self,
        pyramid: Pyramid,
        axes: Axes,
        bound: float | None,
        drawn: Drawing | None,
    ) -> None:
        self.pyramid = pyramid
        self.axes = (axes[0], axes[1], axes[2] and not pyramid.camera.is_uniform)
        self.bound = bound
        self.comparison = Comparison(pyramid, None if drawn is None else drawn.kernel)

    def started(self, starts: Sequence[int], run: Run) -> list[Entry]:
        """Run candidates to their finest scales; return the kernels of their last scales."""
        entries: list[Entry] = []
        for done, (_, new) in enumerate(in_order(self._started, starts, run), 1):
            entries += new
            run.report(done / len(starts), "starts")
        return entries

    def wide(self, run: Run) -> list[Entry]:
        """Estimate kernels of very wide shakes; return those that match the spectra best."""
        starts = [
            Entry(f"wide start {n}, scale {level}", _OF_WIDE - n, level, kernel)
            for n, (level, kernel) in enumerate(wide_starts(self.pyramid, self.axes, run))
            if self.bound is None or kernel.extent_px() <= self.bound
        ]
        wide = [entry for entry in starts if entry.width > _S.least_width * RATIO**entry.level]
        return sorted(wide, key=self.comparison.match, reverse=True)[: _S.wide]

    def spectral(self, run: Run) -> list[Entry]:
        """Find paths by the spectra; return distinct ones that match best, and reflections."""
        found = [
            (self.comparison.match(entry), entry, path)
            for entry, path in self._of_paths(spectral_starts(self.pyramid, self.axes, run))
        ]
        taken: list[Entry] = []
        for _, entry, path in sorted(found, key=lambda one: -one[0]):
            if all(agreement(entry.kernel, known.kernel) < _S.alike for known in taken):
                reflected = entry._replace(
                    name=f"{entry.name}, reflected",
                    start=entry.start - 1,
                    kernel=path.reflected.kernel(self.pyramid.camera),
                )
                taken += [entry, reflected]
            if len(taken) == 2 * _S.spectral:
                break
        return taken

    def _of_paths(
        self, starts: Sequence[tuple[int, SmoothPath]]
    ) -> Iterator[tuple[Entry, SmoothPath]]:
        """Make entries of paths, with numbers that leave room for their reflections."""
        for n, (level, path) in enumerate(starts):
            kernel = path.kernel(self.pyramid.camera)
            name = f"spectral start {n}, scale {level}"
            entry = Entry(name, _OF_SPECTRA - 2 * n, level, kernel)
            entry = entry._replace(level=min(level, self.comparison.level(entry)))
            if self.bound is None or kernel.extent_px() <= self.bound:
                yield entry, path

    def best(self, entries: Sequence[Entry]) -> Entry:
        """Return the best kernel of the starts."""
        return self._ranked(entries)[0]

    def finished(self, entries: list[Entry], run: Run) -> Entry:
        """Refine the kernels of the best starts, add them to the entries, and return the best."""
        ends = _last(entries)
        entries += self._matched(_of_edges(ends))
        best = [entry.start for entry in best_of_starts(self._ranked(entries))][: _S.refined]
        taken = [e for e in ends if e.start in best]
        taken = [e for e in taken if not is_spot(e.kernel)] or taken
        entries += self._refined(taken, run.part(0.0, 0.5))
        entries += self._matched(best_of_starts(self._ranked(entries))[: _S.matched])
        ranked = self._ranked(entries)
        return polished(self.comparison, ranked, ends, self.axes, run.part(0.5, 1.0))

    def _ranked(self, entries: Sequence[Entry]) -> list[Entry]:
        """Sort kernels by their scores, the best first."""
        scores = self.comparison.scores(entries)
        return [entries[i] for i in np.argsort(-scores, kind="stable")]

    def _matched(self, entries: Sequence[Entry]) -> list[Entry]:
        """Fit a smooth path through each kernel to the spectra of the photo."""
        return [self.comparison.matched(e) for e in entries if not is_spot(e.kernel)]

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


def _last(entries: Sequence[Entry]) -> list[Entry]:
    """Return the last kernel of every start."""
    return list({entry.start: entry for entry in entries}.values())
