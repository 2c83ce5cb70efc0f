"""The race between starts: many kernels begun, few continued, the best one kept.

A shake is found from a scale where it is a few pixels wide, and nobody knows which that is. So
candidates start at every second scale; each goes on until its kernel is wide enough to be compared.
Then two witnesses are heard: the judge, on tiles that no candidate saw, and the other candidates,
since kernels that agree from independent starts are seldom wrong. The best go on to the finest
scale that they can reach, are refined there, and are compared once more.

The two finest starts run first. Where both end in a small round spot, the photo was not shaken, and
the race is called off.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deshake.blind.agreement import agreement, agreements
from deshake.blind.candidate import FINE, Axes, Candidate, Refinement, refined
from deshake.blind.judge import Judge
from deshake.blind.spot import is_spot
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.operators.strips import in_order

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from deshake.signal.pyramid import Pyramid

__all__ = ["Entry", "Finish", "race"]

SETTINGS = (FINE, replace(FINE, focus=0.0))
"""Tiles in focus, and tiles wherever there are edges: the one is right for a shallow depth of
field, the other where the steepest edges are those that run along with the shake."""

_COARSEST_START = 11
_COMPARED_AT = 11.0  # px, the width of a kernel that is worth comparing
_LEAST_SCALES = 3  # that a candidate works on before it is compared
_WIDTH_HALFWAY = 16.0  # px at the scale where candidates are compared half-way
_WIDTH_AT_LAST = 28.0  # px at the scale where they are compared at last
_WIDE = 0.7  # quantile of the kernels' widths that decides on the scale of the judge
_WIDEST = 60.0  # px at that scale: wider kernels are out
_CONTINUED = 3
_MOST_CONTINUED = 4  # settings that begin to differ later counted
_SNAPSHOTS = 2  # of a candidate's last scales
_AGREEING = 3  # neighbours that a kernel is compared with
_REFINEMENTS = (Refinement(2e-3), Refinement(1e-2))
_UNIFORM_REFINEMENTS = (Refinement(2e-3), Refinement(1e-3, cut=0.015))
_COLLAPSED = 10.0  # taken off a small round spot: other starts found more
_ROLL_WORTH = 0.003  # margin that a roll must bring
_LEAST_WIDTH = 2.5  # px at its scale, below which a kernel is a point and not refined
_CUT = 0.05  # weights below this share of the largest do not make a kernel wider


class Entry(NamedTuple):
    """A kernel in the race.

    Parameters
    ----------
    name : str
        Where it comes from.
    start, level : int
        The scales that it was begun and estimated at.
    kernel : RotationKernel
        For the camera of the photo, centred.
    focus : float
        How much tiles in focus were preferred.

    """

    name: str
    start: int
    level: int
    kernel: RotationKernel
    focus: float


class Finish(NamedTuple):
    """How a race ended.

    Parameters
    ----------
    winner : Entry
        The best kernel.
    margin : float
        How much better the judge finds it than a camera that stands still.
    agreement : float
        Mean agreement of the winner with the two nearest kernels of other starts, 0..1.
    at_rest : bool
        Whether the race was called off: the winner is a small round spot.

    """

    winner: Entry
    margin: float
    agreement: float
    at_rest: bool


def race(
    pyramid: Pyramid,
    *,
    axes: Axes = ALL_AXES,
    bound: float | None = None,
    quick: bool = False,
    may_rest: bool = True,
    threads: int = 1,
    progress: Callable[[float, str], None] | None = None,
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
        Whether only the best start is continued, and nothing is refined.
    may_rest : bool
        Whether the race is called off where the finest starts leave a spot. Wide shakes may leave
        one, too: the photo must look fairly sharp.
    threads : int
        Threads to use. The result does not depend on it.
    progress : callable, optional
        Called with the share done, 0..1, and a text.

    """
    course = _Course(pyramid, axes, bound, threads, progress or (lambda _share, _text: None))
    starts = list(range(min(pyramid.coarsest, _COARSEST_START), 0, -2))[::-1] or [0]
    first = course.begun(starts[:2], 0.0, 0.15)
    if may_rest and all(is_spot(run.kernel) and run.level == 0 for run in first):
        entry = _entry(first[0])
        course.progress(1.0, "the photo is not shaken")
        return Finish(entry, 0.0, 1.0, at_rest=True)
    runs = first + course.begun(starts[2:], 0.15, 0.45)
    halfway = [_entry(run) for run in runs]
    order = np.argsort(-course.chances(halfway), kind="stable")
    taken = [one for i in order[: 1 if quick else _CONTINUED] for one in _variants(runs[i])]
    taken = taken[: 1 if quick else _MOST_CONTINUED]
    finals = course.continued(taken, 0.5, 0.65)
    if not quick:
        finals += course.refined(finals, 0.65, 0.85)
    finals = [entry for entry in finals if not is_spot(entry.kernel)] or finals
    margins = course.margins(finals, _WIDTH_AT_LAST)
    best = int(np.argmax(margins))
    winner, margin = finals[best], float(margins[best])
    if not quick:
        winner, margin = course.without_roll(winner, margin)
    others = [entry.kernel for entry in (*halfway, *finals) if entry.start != winner.start]
    alike = sorted((agreement(winner.kernel, other) for other in others), reverse=True)[:2]
    course.progress(1.0, "kernel estimated")
    return Finish(winner, margin, float(np.mean(alike or [0.0])), at_rest=False)


class _Course:
    """What all steps of a race share."""

    def __init__(
        self,
        pyramid: Pyramid,
        axes: Axes,
        bound: float | None,
        threads: int,
        progress: Callable[[float, str], None],
    ) -> None:
        self.pyramid = pyramid
        self.axes = (axes[0], axes[1], axes[2] and not pyramid.camera.is_uniform)
        self.bound = bound
        self.threads = threads
        self.progress = progress

    def begun(self, starts: Sequence[int], since: float, until: float) -> list[Candidate]:
        """Work candidates to where they are compared."""
        runs: list[Candidate] = []
        for done, (_, found) in enumerate(in_order(self._begun, starts, self.threads), 1):
            runs += found
            self.progress(since + (until - since) * done / len(starts), "starts")
        return runs

    def chances(self, entries: Sequence[Entry]) -> NDArray[np.float64]:
        """Margin of each kernel, and how well it agrees with its nearest neighbours."""
        margins = self.margins(entries, _WIDTH_HALFWAY)
        alike = agreements([entry.kernel for entry in entries])
        np.fill_diagonal(alike, 0)
        nearest = -np.sort(-alike, axis=1)[:, :_AGREEING]
        collapsed = [is_spot(entry.kernel) for entry in entries]
        chances: NDArray[np.float64] = margins + nearest.mean(1) - _COLLAPSED * np.array(collapsed)
        return chances

    def continued(self, runs: Sequence[Candidate], since: float, until: float) -> list[Entry]:
        """Work candidates to their ends; the kernels of their last scales."""
        entries: list[Entry] = []
        for done, (_, found) in enumerate(in_order(_to_end, runs, self.threads), 1):
            entries += found
            self.progress(since + (until - since) * done / len(runs), "best starts")
        return entries

    def refined(self, entries: Sequence[Entry], since: float, until: float) -> list[Entry]:
        """Refine the last kernel of every start."""
        last = {(entry.start, entry.focus): entry for entry in entries}.values()
        uniform = self.pyramid.camera.is_uniform
        ways = _UNIFORM_REFINEMENTS if uniform else _REFINEMENTS
        jobs = [(entry, how) for entry in last for how in ways]
        found = []
        work = in_order(lambda job: self._refined(*job), jobs, self.threads)
        for done, (_, entry) in enumerate(work, 1):
            found.append(entry)
            self.progress(since + (until - since) * done / len(jobs), "refinement")
        return found

    def margins(self, entries: Sequence[Entry], width: float) -> NDArray[np.float64]:
        """Margins at the scale where most of the kernels are at most so many pixels wide."""
        widths = np.array([entry.kernel.above(_CUT).extent_px() for entry in entries])
        level = int(np.ceil(2 * np.log2(max(float(np.quantile(widths, _WIDE)) / width, 1e-9))))
        level = int(np.clip(level, 0, self.pyramid.coarsest))
        shrink = self.pyramid.at(level).camera.width / self.pyramid.camera.width
        fits = [i for i, width in enumerate(widths * shrink) if width <= _WIDEST]
        margins = np.full(len(entries), -1.0)
        if not fits:
            return margins
        judge = Judge.of(self.pyramid, level, [entries[i].kernel for i in fits])
        margins[fits] = [judge.margin(entries[i].kernel) for i in fits]
        return margins

    def without_roll(self, winner: Entry, margin: float) -> tuple[Entry, float]:
        """Take the roll off a kernel unless the tiles that were kept apart ask for it."""
        if not self.axes[2] or not winner.kernel.theta[:, 2].any():
            return winner, margin
        flat = self._refined(winner, _REFINEMENTS[0], axes=(self.axes[0], self.axes[1], False))
        entries = [winner, flat._replace(name=f"{winner.name}, no roll")]
        margins = self.margins(entries, _WIDTH_AT_LAST)
        if margins[1] >= margins[0] - _ROLL_WORTH:
            return entries[1], margin + float(margins[1] - margins[0])
        return winner, margin

    def _begun(self, start: int) -> list[Candidate]:
        """Work one start to where it is compared, with every setting once they differ."""
        run = Candidate(self.pyramid, start, SETTINGS[0], axes=self.axes, bound=self.bound)
        while not run.chooses_next and not _is_halfway(run) and run.advance():
            pass
        if _is_halfway(run) or not run.chooses_next:
            return [run]
        runs = _variants(run)
        for one in runs:
            while not _is_halfway(one) and one.advance():
                pass
        return runs

    def _refined(self, entry: Entry, how: Refinement, axes: Axes | None = None) -> Entry:
        if self._is_point(entry):
            return entry
        kernel = refined(
            self.pyramid,
            entry.kernel,
            entry.level,
            how,
            axes=axes or self.axes,
            focus=entry.focus,
        )
        return entry._replace(name=f"{entry.name}, refined at {how.price:g}", kernel=kernel)

    def _is_point(self, entry: Entry) -> bool:
        camera = self.pyramid.at(entry.level).camera
        return entry.kernel.for_camera(camera).extent_px() < _LEAST_WIDTH


def _is_halfway(run: Candidate) -> bool:
    """Whether a candidate's kernel is wide enough to be compared."""
    return run.start - run.level >= _LEAST_SCALES - 1 and run.width > _COMPARED_AT


def _variants(run: Candidate) -> list[Candidate]:
    """Return a candidate with every setting, if its settings are still to make a difference."""
    if not run.chooses_next:
        return [run]
    return [run, *(run.forked(setting) for setting in SETTINGS[1:])]


def _to_end(run: Candidate) -> list[Entry]:
    entries = [_entry(run)]
    while run.advance():
        entries.append(_entry(run))
    return entries[-_SNAPSHOTS:]


def _entry(run: Candidate) -> Entry:
    focus = run.setting.focus
    name = f"start {run.start}{'' if focus else ', any focus'}, scale {run.level}"
    return Entry(name, run.start, run.level, run.kernel, focus)
