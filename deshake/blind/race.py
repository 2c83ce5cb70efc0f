"""The race between starts: a kernel from every first scale, the best ones refined, one kept.

A shake is found from a scale where it is a few pixels wide, and nobody knows which that is. So
candidates start at every second scale, and each goes on to the finest scale that it can reach. Then
two witnesses are heard: the judge, on tiles that no candidate saw, and the other candidates, since
kernels that agree from independent starts are seldom wrong. The best are refined, with roll and
without, and are compared once more.

The two finest starts run first. Where both end in a small round spot, the photo was not shaken, and
the race is called off.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deshake.blind.agreement import agreement
from deshake.blind.camera_path import thinned
from deshake.blind.candidate import Axes, Candidate, Refinement, refined
from deshake.blind.judge import Judge
from deshake.blind.spot import is_spot
from deshake.blind.trimming import heaviest
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.operators.strips import in_order

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from deshake.signal.pyramid import Pyramid

__all__ = ["Entry", "Finish", "race"]

_COARSEST_START = 11
_OWN_WIDTH = 8.0  # px of a kernel at the scale where it is judged by itself
_COMMON_WIDTH = 28.0  # px of kernels at the scale where they are judged side by side
_WIDE = 0.6  # quantile of the kernels' widths that decides on that scale
_WIDEST_OF_MOST = 0.9  # quantile, for photos of which the energy says nothing
_SILENT = 0.015  # margin that no kernel reaches there
_MOST_LOSS = 0.05  # of energy
_SHARPENING_WORTH = 0.6  # of margin, for a gain of 1 in -ln nsp
_WIDEST = 48.0  # px at that scale: wider kernels are out
_REFINED = 3  # starts
_COMPARED = 6  # kernels, side by side
_SNAPSHOTS = 2  # of a candidate's last scales
_AGREEMENT_WORTH = 0.2  # of margin, for an agreement of 1
_AGREEING = 3  # neighbours that a kernel is compared with
_REFINEMENT = Refinement(2e-3)
_OTHER_REFINEMENT = Refinement(1e-2)  # that the winner is tried with
_PATH_REFINEMENT = Refinement(2e-3, iterations=4, cut=0.01, room=False)  # of a thin path
_WIDE_PATH = 1.4  # grid steps
_UNIFORM_REFINEMENT = Refinement(1e-3)
_COLLAPSED = 10.0  # taken off a small round spot: other starts found more
_ROLL_WORTH = 0.003  # of margin, that roll must bring
_LEAST_WIDTH = 2.5  # px at its scale, below which a kernel is a point and not refined
_FAINT = 0.05  # of the weight, that does not make a kernel wider


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

    """

    name: str
    start: int
    level: int
    kernel: RotationKernel


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
    found = course.run(starts[:2], 0.0, 0.15)
    if may_rest and all(is_spot(e.kernel) and e.level == 0 for e in _last(found)):
        course.progress(1.0, "the photo is not shaken")
        return Finish(_last(found)[0], 0.0, 1.0, at_rest=True)
    found += course.run(starts[2:], 0.15, 0.5)
    chances = course.chances(found, found)
    order = [found[i] for i in np.argsort(-chances, kind="stable")]
    winner = order[0]
    if not quick:
        best = dict.fromkeys(entry.start for entry in order)
        ends = _last(found)
        taken = [e for e in ends if e.start in list(best)[:_REFINED]]
        taken = [e for e in taken if not is_spot(e.kernel)] or taken
        finals = course.refined(taken, 0.5, 0.85)
        finals += [e for e in found if e.start in {one.start for one in taken}]
        found += finals
        chances = course.chances(finals, found)
        compared = np.argsort(-chances, kind="stable")[:_COMPARED]
        finals, chances = [finals[i] for i in compared], chances[compared]
        compare = course.side_by_side
        margins = compare(finals)
        if margins.max() < _SILENT:
            finals, compare = found, course.by_sharpness
            chances = _AGREEMENT_WORTH * np.array([_nearest(entry, found) for entry in found])
            margins = compare(found)
        winner = course.polished(finals[int(np.argmax(chances + margins))], ends, compare)
    margin = float(course.margins([winner])[0])
    course.progress(1.0, "kernel estimated")
    return Finish(winner, margin, _nearest(winner, found), at_rest=False)


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

    def run(self, starts: Sequence[int], since: float, until: float) -> list[Entry]:
        """Work candidates to their ends; the kernels of their last scales."""
        entries: list[Entry] = []
        for done, (_, found) in enumerate(in_order(self._run, starts, self.threads), 1):
            entries += found
            self.progress(since + (until - since) * done / len(starts), "starts")
        return entries

    def chances(self, entries: Sequence[Entry], known: Sequence[Entry]) -> NDArray[np.float64]:
        """Hear both witnesses: each kernel's margin, and how well it agrees with what is known."""
        alike = np.array([_nearest(entry, known) for entry in entries])
        collapsed = np.array([is_spot(entry.kernel) for entry in entries])
        chances: NDArray[np.float64] = (
            self.margins(entries) + _AGREEMENT_WORTH * alike - _COLLAPSED * collapsed
        )
        return chances

    def refined(self, entries: Sequence[Entry], since: float, until: float) -> list[Entry]:
        """Refine kernels, with roll and without."""
        uniform = self.pyramid.camera.is_uniform
        ways = (_REFINEMENT, _UNIFORM_REFINEMENT) if uniform else (_REFINEMENT,)
        jobs = [(entry, how, self.axes) for entry in entries for how in ways]
        if self.axes[2]:
            flat = (self.axes[0], self.axes[1], False)
            jobs += [(entry, how, flat) for entry in entries for how in ways]
        found = []
        work = in_order(lambda job: self._refined(*job), jobs, self.threads)
        for done, (_, entry) in enumerate(work, 1):
            found.append(entry)
            self.progress(since + (until - since) * done / len(jobs), "refinement")
        return found

    def margins(self, entries: Sequence[Entry]) -> NDArray[np.float64]:
        """Margins of kernels, each at the scale where it is a few pixels wide.

        There a kernel that is too narrow has nothing to gain, and one too wide loses: no other
        kernel's width decides on where to look.
        """
        levels = np.array([self._level(_width(entry), _OWN_WIDTH) for entry in entries])
        margins = np.empty(len(entries))
        for level in np.unique(levels):
            at = np.flatnonzero(levels == level)
            margins[at] = self._judged([entries[int(i)] for i in at], int(level))
        return margins

    def side_by_side(self, entries: Sequence[Entry]) -> NDArray[np.float64]:
        """Margins of kernels at one scale, where most of them are well resolved."""
        return self._compared(entries, _WIDE, self._judged)

    def by_sharpness(self, entries: Sequence[Entry]) -> NDArray[np.float64]:
        """How much sharper kernels make the photo, at one scale; a loss of energy counts little.

        For photos of which the energy says nothing: fine texture costs the true kernel some.
        """

        def score(judge: Judge, entry: Entry) -> float:
            lost = max(judge.margin(entry.kernel), -_MOST_LOSS)
            return lost + _SHARPENING_WORTH * judge.sharpening(entry.kernel)

        def scores(fitting: Sequence[Entry], level: int) -> NDArray[np.float64]:
            judge = Judge.of(self.pyramid, level, [entry.kernel for entry in fitting])
            return np.array([score(judge, entry) for entry in fitting])

        return self._compared(entries, _WIDEST_OF_MOST, scores)

    def _compared(
        self,
        entries: Sequence[Entry],
        quantile: float,
        scores: Callable[[Sequence[Entry], int], NDArray[np.float64]],
    ) -> NDArray[np.float64]:
        """Scores of kernels at the scale where those of a quantile of the widths are resolved."""
        widths = np.array([_width(entry) for entry in entries])
        level = self._level(float(np.quantile(widths, quantile)), _COMMON_WIDTH)
        shrink = self.pyramid.at(level).camera.width / self.pyramid.camera.width
        compared = np.full(len(entries), -1.0)
        fits = np.flatnonzero(widths * shrink <= _WIDEST)
        if len(fits):
            compared[fits] = scores([entries[int(i)] for i in fits], level)
        return compared - _COLLAPSED * np.array([is_spot(entry.kernel) for entry in entries])

    def _level(self, width: float, wanted: float) -> int:
        """Return the scale at which so many pixels of the photo are as many as wanted."""
        level = np.ceil(2 * np.log2(max(width / wanted, 1e-9)))
        return int(np.clip(level, 0, self.pyramid.coarsest))

    def _judged(self, entries: Sequence[Entry], level: int) -> NDArray[np.float64]:
        judge = Judge.of(self.pyramid, level, [entry.kernel for entry in entries])
        margins = np.array([judge.margin(entry.kernel) for entry in entries])
        if self.axes[2]:
            margins -= [_ROLL_WORTH * bool(entry.kernel.theta[:, 2].any()) for entry in entries]
        return margins

    def polished(
        self,
        winner: Entry,
        sources: Sequence[Entry],
        compare: Callable[[Sequence[Entry]], NDArray[np.float64]],
    ) -> Entry:
        """Refine what the winner came from by other edges, thin it, and return the best."""
        source = next(entry for entry in sources if entry.start == winner.start)
        flat = not winner.kernel.theta[:, 2].any()
        axes = (self.axes[0], self.axes[1], self.axes[2] and not flat)
        other = self._refined(source, _OTHER_REFINEMENT, axes)
        path = self._refined(_thin(winner, _WIDE_PATH), _PATH_REFINEMENT, axes)
        entries = [winner, _thin(winner), other, _thin(other), path, _thin(path)]
        return entries[int(np.argmax(compare(entries)))]

    def _run(self, start: int) -> list[Entry]:
        """Work one start to its end."""
        run = Candidate(self.pyramid, start, axes=self.axes, bound=self.bound)
        entries = []
        while run.advance():
            name = f"start {start}, scale {run.level}"
            entries.append(Entry(name, start, run.level, run.kernel))
        return entries[-_SNAPSHOTS:]

    def _refined(self, entry: Entry, how: Refinement, axes: Axes) -> Entry:
        if self._is_point(entry):
            return entry
        kernel = refined(self.pyramid, entry.kernel, entry.level, how, axes=axes)
        flat = ", no roll" if self.axes[2] and not axes[2] else ""
        return entry._replace(name=f"{entry.name}, refined at {how.price:g}{flat}", kernel=kernel)

    def _is_point(self, entry: Entry) -> bool:
        camera = self.pyramid.at(entry.level).camera
        return entry.kernel.for_camera(camera).extent_px() < _LEAST_WIDTH


def _width(entry: Entry) -> float:
    """Width of a kernel in pixels of the photo."""
    return heaviest(entry.kernel, _FAINT).extent_px()


def _nearest(entry: Entry, known: Sequence[Entry]) -> float:
    """Mean agreement of a kernel with the nearest ones of other starts."""
    others = [one.kernel for one in known if one.start != entry.start]
    alike = sorted((agreement(entry.kernel, other) for other in others), reverse=True)
    return float(np.mean(alike[:_AGREEING] or [0.0]))


def _thin(entry: Entry, width: float = 1.0) -> Entry:
    """Take the thickness off a kernel."""
    return entry._replace(name=f"{entry.name}, thin", kernel=thinned(entry.kernel, width))


def _last(entries: Sequence[Entry]) -> list[Entry]:
    """Return the last kernel of every start."""
    return list({entry.start: entry for entry in entries}.values())
