"""The course of a race in one kind of tones: starts, then refinements of the best kernels.

An estimate needs a first scale where the shake is a few pixels wide. This scale is unknown. So
candidates start at every second scale (in a small photo, at every scale), and each continues to the
finest scale that it can reach.

The score of the comparison then ranks the kernels, on tiles that no candidate used
(`kernel_comparison`). A smooth path through each kernel is fitted to the spectra of the photo
(`spectral_match`). The best kernels are refined, with roll and without, fitted to the spectra once
more, and ranked again. If the best one is wide for the frame, it may be a part of a kernel, and
grows (`growth`). The best kernels of two starts are polished (`polish`). A better path is searched
for along the winner (`path_search`), which then becomes as narrow as the photo allows
(`narrowing`).

Every second start carries its kernel as a thin path from scale to scale. Wide shakes often
succeed in only one of the two ways. Very wide shakes have starts of their own (`wide_start`). If
the best kernel of the other starts is beyond doubt, these take part only if one of them is much
wider and better: the other kernel may be a part of it. Then fewer kernels are refined, and no other
starts run. Otherwise further starts need no latent picture: they are the paths that match the
spectra best (`spectral_start`). The spectra cannot tell a path from its reflection, so both take
part. A tiny photo has few tiles. There the wide starts see more, and always take part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.candidate import Candidate
from deshake.blind.entry import Entry, all_refined, best_of_starts, last_of_starts, nearest
from deshake.blind.finish import Finish
from deshake.blind.focal_search import best_zoom
from deshake.blind.growth import grown
from deshake.blind.kernel_comparison import Comparison
from deshake.blind.polish import polished, polished_on_frame
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_start import spectral_entries
from deshake.blind.spot import is_spot
from deshake.blind.trust import confidence, selected
from deshake.blind.wide_start import wide_starts
from deshake.operators.strips import in_order, reported
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.candidate import Axes
    from deshake.blind.judge import Judge
    from deshake.blind.settings import PathScales
    from deshake.run import Run
    from deshake.signal.pyramid import Pyramid

__all__ = ["Course", "first_scales"]

_S: Final = SETTINGS.course
_WAYS: Final = (SETTINGS.candidate.fine, SETTINGS.candidate.thin)  # the starts use them in turn
_OF_WIDE = -1  # number of the first wide start, which is no scale; the others count downwards
_OF_SPECTRA = -100  # number of the first spectral start; the others count downwards


class Course:
    """The photo, the settings, and the kernels that all steps share.

    The parameters are those of `race`.
    """

    def __init__(
        self,
        pyramid: Pyramid,
        axes: Axes,
        bound: float | None,
        *,
        any_focal: bool,
        toned: bool = False,
        run: Run,
    ) -> None:
        self.pyramid = pyramid
        self.axes = (axes[0], axes[1], axes[2] and not pyramid.camera.is_uniform)
        self.bound = bound
        self.comparison = Comparison(pyramid, run)
        self.any_focal = any_focal and not pyramid.camera.is_uniform
        self.toned = toned
        self.zoom = 1.0
        self.entries: list[Entry] = []
        self.ends: list[Entry] = []
        self.leaders: list[Entry] = []

    def end(self, hopeful: float, run: Run) -> Finish:
        """Refine the best kernels, if one gives hope; return what the best of them is worth."""
        return self.finish(run) if self.gives_hope(hopeful) else self.finished(self.leaders[0])

    def in_display_values(self) -> Course:
        """Return the course in the display values of the photo, before any start."""
        return self._in(self.pyramid.displayed())

    def _in(self, pyramid: Pyramid) -> Course:
        """Return the course in other tones of the photo, before any start."""
        axes, bound, run = self.axes, self.bound, self.comparison.run
        return Course(pyramid, axes, bound, any_focal=self.any_focal, toned=self.toned, run=run)

    def continued_in_display_values(self) -> Course:
        """Return the course in display values, with the kernels and the focal length so far."""
        shown = self.in_display_values()
        shown.zoom, shown.entries = self.zoom, self.entries
        return shown

    def continued_in(self, light: Comparison) -> Course:
        """Return the course in another light, with the best kernels so far."""
        other = self._in(light.pyramid)
        other.comparison = light
        other.adopt(self)
        return other

    def adopt(self, other: Course) -> None:
        """Add the best kernels of another course, and the ends of their starts."""
        best = {entry.start for entry in other.leaders}
        ends = [entry for entry in other.ends if entry.start in best]
        self.entries += [*ends, *other.leaders]
        self.ends = best_of_starts(self._ranked([*self.ends, *ends]))
        self.leaders = self._leaders()

    def begin(self, starts: Sequence[int], run: Run, *, quick: bool) -> None:
        """Run the starts of edges at the given scales; find the best kernels of the best.

        With `quick`, no smooth paths take part.
        """
        self.start(starts, run)
        if quick:
            self.leaders = self._leaders()
        else:
            self._end_starts()

    def begin_others(self, run: Run) -> None:
        """Run the starts that do not begin with edges, unless those left no doubt."""
        self.begin_wide(run.part(0.0, 0.25))
        self.begin_spectral(run.part(0.25, 1.0))

    def begin_wide(self, run: Run, least_match: float = -1.0) -> None:
        """Run the starts of very wide shakes; those that match less than `least_match` are out.

        If the best kernel so far is beyond doubt, only those that are much wider run, and they are
        out, too, unless one of them is better. In a tiny photo all of them take part.
        """
        before = self.entries, self.ends, self.leaders
        leader = self.leaders[0] if self.sure and not self._is_tiny else None
        if leader is not None:
            least_match = _S.wide_share * self.comparison.match(leader)
        wide, paths = self._wide(run, least_match, leader)
        jobs = [(path, _S.refinement, self._flat) for path in paths]
        if leader is not None or self._is_tiny:  # else they push other kernels out
            jobs += [(self.comparison.suited(entry), _S.refinement, self._flat) for entry in wide]
        refined = all_refined(self.pyramid, jobs, self.comparison.run)
        paths, kernels = refined[: len(wide)], refined[len(wide) :]
        self.entries = [*self.entries, *paths, *wide, *kernels]
        self._end_starts()
        if leader is not None and not _is_of_wide(self.leaders[0]):
            self.entries, self.ends, self.leaders = before

    def begin_spectral(self, run: Run) -> None:
        """Run the starts that the spectra give, unless there is no doubt."""
        if self.sure:
            return
        usual, wider = SETTINGS.spectral_start.usual, SETTINGS.spectral_start.wide
        self.start_spectral(usual, run.part(0.0, 0.5))
        self._end_starts()
        if self.may_be_wide(self.leaders[0]):
            self.start_spectral(wider, run.part(0.5, 1.0))
            self._end_starts()

    def score(self, entries: Sequence[Entry]) -> float:
        """Return the highest score of kernels."""
        return float(self.comparison.scores(entries).max())

    def start(self, starts: Sequence[int], run: Run) -> None:
        """Run candidates to their finest scales; keep the kernels of their last scales.

        The coarsest starts take the longest, so they run first.
        """
        coarsest_first = sorted(starts, reverse=True)
        found = dict(reported(self._started, coarsest_first, run, "starts"))
        self.entries += [entry for start in starts for entry in found[start]]

    def _wide(
        self, run: Run, least_match: float, narrow: Entry | None
    ) -> tuple[list[Entry], list[Entry]]:
        """Estimate kernels of very wide shakes; return those whose paths match best, and the paths.

        If a narrow kernel is given, all are much wider.
        """
        wide = [
            Entry(f"wide start {n}, scale {level}", _OF_WIDE - n, level, kernel)
            for n, (level, kernel) in enumerate(wide_starts(self.pyramid, self.axes, run))
        ]
        wide = [entry for entry in wide if entry.keeps(self.bound)]
        wide = [entry for entry in wide if entry.width > _S.least_width * RATIO**entry.level]
        if narrow is not None:
            wide = [entry for entry in wide if self.comparison.is_much_wider(entry, narrow)]
        paths = self._matched(wide)
        matches = self.comparison.matches(paths)
        ranked = np.argsort(-matches, kind="stable")[: _S.wide]
        kept = [n for n in ranked if matches[n] >= least_match]
        return [wide[n] for n in kept], [paths[n] for n in kept]

    def start_spectral(self, scales: PathScales, run: Run) -> list[Entry]:
        """Keep and return the kernels of paths that the spectra give."""
        first = min([_OF_SPECTRA, *(entry.start - 1 for entry in self.entries)])
        taken = spectral_entries(self.comparison, self.axes, self.bound, run, scales, first=first)
        self.entries += taken
        return taken

    def best_begun(self) -> Entry:
        """Return the best of the kernels so far and of smooth paths through the last ones."""
        paths = self._matched(last_of_starts(self.entries))
        return self._ranked([*self.entries, *paths])[0]

    @property
    def sure(self) -> bool:
        """Whether there are starts, and their best kernel is beyond doubt."""
        if not self.leaders:
            return False
        return self.confidence(self.leaders[0]) >= SETTINGS.estimate.doubtful

    def gives_hope(self, least: float) -> bool:
        """Return whether one of the best kernels has so much confidence."""
        return any(self.confidence(leader) >= least for leader in self.leaders)

    def may_be_wide(self, leader: Entry) -> bool:
        """Return whether the shake may be wider than most starts can find."""
        wide = self.comparison.is_wide(leader)
        return wide or self.confidence(leader) < SETTINGS.estimate.even

    def confidence(self, winner: Entry) -> float:
        """Return the confidence of a kernel, if it wins."""
        return confidence(self.finished(winner))

    def finished(self, winner: Entry, judge: Judge | None = None) -> Finish:
        """Return what the confidence of a kernel depends on, if it wins.

        By default it is judged at the scale that suits it.
        """
        comparison = self.comparison
        judge = judge or comparison.judge(winner)
        alike = nearest(winner, _of_edges(self.entries))
        return Finish(
            winner,
            winner.margin(judge),
            comparison.match(winner),
            alike,
            at_rest=False,
            zoom=self.zoom,
            tones=self.pyramid.tones,
        )

    def best(self) -> Entry:
        """Return the best kernel."""
        best = self._ranked(self.entries)[0]
        return best.zoomed(self._focus([best]))

    def _end_starts(self) -> None:
        """Keep the last kernels of new starts, and find the best kernels of all.

        Smooth paths through those of edges take part.
        """
        known = {end.start for end in self.ends}
        ends = last_of_starts([entry for entry in self.entries if entry.start not in known])
        self.ends = [*self.ends, *ends]
        self.entries += self._matched(_of_edges(ends))
        self.leaders = self._leaders()

    def _leaders(self) -> list[Entry]:
        """Return the best kernels of the best starts, and those that wide starts push out."""
        ranked = self._best_of_starts(self.entries)
        others = [entry for entry in ranked if not _is_of_wide(entry)][: _S.refined]
        starts = {entry.start for entry in [*ranked[: _S.refined], *others]}
        return [entry for entry in ranked if entry.start in starts]

    def finish(self, run: Run) -> Finish:
        """Refine the kernels of the best starts, keep them, too; return what the best is worth.

        If the best of them is beyond doubt, fewer are refined and polished.
        """
        count = _S.refined_if_sure if self.sure else len(self.leaders)
        lines = 1 if self.sure and not self._is_tiny else _S.polished
        leaders = self.leaders[:count]
        starts = {entry.start for entry in leaders}
        ends = _zoomed(self.ends, self._focus(leaders))
        taken = [end for end in ends if end.start in starts]
        taken = [end for end in taken if not is_spot(end.kernel)] or taken
        self.entries += self._refined(taken, run.part(0.0, 0.5))
        self.entries += self._matched(self._best_of_starts(self._contenders(starts))[:count])
        best = self._best_of_starts(self._contenders(starts))[:lines]
        ratio = self._focus(best)
        best, ends = _zoomed(best, ratio), _zoomed(ends, ratio)
        leader = grown(self.comparison, best[0], self.axes, self.bound, toned=self.toned)
        if leader is not best[0]:
            best = [leader]  # the kernel of another start would have to grow, too
        polish = run.part(0.5, 1.0)
        last = polished(self.comparison, best, ends, self.axes, polish)
        return selected(
            self.finished(one.entry, one.judge)._replace(lead=self.comparison.lead(one.entry))
            for one in last
        )

    def searched(self, ended: Finish, run: Run) -> Finish:
        """Replace the winner by a better, narrow path along it; its old worth still counts."""
        found = self.comparison.searched(ended.winner, run)
        return ended._replace(winner=self.comparison.narrowed(found, run.silent()))

    def polished_on_frame(self, ended: Finish, run: Run) -> Finish:
        """Refine a winner that is wide for the frame on the whole frame once more."""
        best = polished_on_frame(self.comparison, ended.winner, self.axes, run)
        if best is ended.winner or not best.keeps(self.bound):
            return ended
        return self.finished(best)._replace(lead=self.comparison.lead(best))

    def _focus(self, best: Sequence[Entry]) -> float:
        """Take the focal length that suits the kernels, unless it is known; return the zoom."""
        ratio = best_zoom(self.comparison, best) if self.any_focal else 1.0
        if ratio != 1:
            self.zoom *= ratio
            self.comparison = self.comparison.zoomed(ratio)
            self.pyramid = self.comparison.pyramid
            self.entries = _zoomed(self.entries, ratio)
        return ratio

    @property
    def _is_tiny(self) -> bool:
        """Whether some wide start ends at the size of the photo, where it sees more than tiles."""
        return min(self.pyramid.camera.shape) <= _S.tiny

    @property
    def _flat(self) -> Axes:
        """The axes without roll."""
        return self.axes[0], self.axes[1], False

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

    def _best_of_starts(self, entries: Sequence[Entry]) -> list[Entry]:
        """Return the best kernel of every start, the best first."""
        return self.comparison.foremost(best_of_starts(self._ranked(entries)))

    def _matched(self, entries: Sequence[Entry]) -> list[Entry]:
        """Fit a smooth path through each kernel to the spectra of the photo."""
        comparison = self.comparison
        blurred = [entry for entry in entries if not is_spot(entry.kernel)]
        return [path for _, path in in_order(comparison.matched, blurred, comparison.run)]

    def _refined(self, entries: Sequence[Entry], run: Run) -> list[Entry]:
        """Refine kernels, with roll and without."""
        uniform = self.pyramid.camera.is_uniform
        ways = (_S.refinement, _S.uniform_refinement) if uniform else (_S.refinement,)
        all_axes = (self.axes, self._flat) if self.axes[2] else (self.axes,)
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


def first_scales(coarsest: int) -> list[int]:
    """Return the first scales of all starts, the finest first."""
    coarsest = min(coarsest, _S.coarsest_start)
    sparse = list(range(coarsest, 0, -2))[::-1] or [0]
    return sparse if len(sparse) >= _S.fewest_starts else list(range(1, coarsest + 1)) or [0]


def _of_edges(entries: Sequence[Entry]) -> list[Entry]:
    """Return the kernels that edges gave. Those of spectral starts resemble each other."""
    return [entry for entry in entries if entry.start > _OF_SPECTRA]


def _is_of_wide(entry: Entry) -> bool:
    """Return whether a wide start gave a kernel."""
    return _OF_SPECTRA < entry.start <= _OF_WIDE


def _zoomed(entries: Sequence[Entry], ratio: float) -> list[Entry]:
    """Return the kernels for a focal length `ratio` times as long."""
    return [entry.zoomed(ratio) for entry in entries]
