"""The race: candidates from several first scales; the best are refined, and one is kept.

An estimate needs a first scale where the shake is a few pixels wide. This scale is unknown. So
candidates start at every second scale, and each continues to the finest scale that it can reach.
Two measures then compare the kernels. One is the margin of the judge, on tiles that no candidate
used. The other is the agreement with the kernels of other starts, because kernels that agree from
independent starts are seldom wrong. The best kernels are refined, with roll and without, and are
compared again.

The two finest starts run first. If both end in a small round spot, the photo was not shaken, and
the race stops.
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
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from deshake.signal.pyramid import Pyramid

__all__ = ["Entry", "Finish", "race"]

_COARSEST_START = 11  # index of a scale
_OWN_WIDTH = 8.0  # px of a kernel at the scale of its own judgement
_COMMON_WIDTH = 28.0  # px of the kernels at the scale of a common comparison
_WIDE = 0.6  # quantile of the kernels' widths; it sets the scale of a common comparison
_WIDEST_OF_MOST = 0.9  # the same quantile, if the energy shows no difference between kernels
_SILENT = 0.015  # margin; if no kernel reaches it, the energy shows no difference
_MOST_LOSS = 0.05  # margin: largest loss that a comparison by sharpness counts
_SHARPENING_WORTH = 0.6  # margin per gain of 1 in -ln nsp
_WIDEST = 48.0  # px at the scale of a common comparison; wider kernels are not compared
_REFINED = 3  # number of starts
_COMPARED = 6  # number of kernels in a common comparison
_SNAPSHOTS = 2  # number of last scales of a candidate whose kernels are kept
_AGREEMENT_WORTH = 0.2  # margin per agreement of 1
_AGREEING = 3  # number of nearest kernels in the mean agreement
_REFINEMENT = Refinement(2e-3)  # price in squared contrast of the pyramid
_OTHER_REFINEMENT = Refinement(1e-2)  # the same, a second try for the winner
_PATH_REFINEMENT = Refinement(2e-3, iterations=4, cut=0.01, room=False)  # the same, a thin path
_WIDE_PATH = 1.4  # grid steps: width of the neighbourhood on a thin path
_UNIFORM_REFINEMENT = Refinement(1e-3)  # the same price, for the uniform model
_COLLAPSED = 10.0  # margin: penalty of a small round spot, larger than any gain
_ROLL_WORTH = 0.003  # margin: least gain that justifies a kernel with roll
_LEAST_WIDTH = 2.5  # px of the kernel's scale; a narrower kernel is a point and is not refined
_FAINT = 0.05  # share of the kernel's weight that its width does not count


class Entry(NamedTuple):
    """A kernel in the race.

    Parameters
    ----------
    name : str
        Origin of the kernel, for the log.
    start, level : int
        Index of its first scale, and of the scale of its estimate.
    kernel : RotationKernel
        The kernel, for the camera of the photo, centred.

    """

    name: str
    start: int
    level: int
    kernel: RotationKernel


class Finish(NamedTuple):
    """The result of a race.

    Parameters
    ----------
    winner : Entry
        The best kernel.
    margin : float
        Margin of the winner: its gain in the judge's ``-ln E`` over a still camera.
    agreement : float
        Mean agreement of the winner with the nearest kernels of other starts, 0..1.
    at_rest : bool
        Whether the race stopped early, because the winner is a small round spot.

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
    run : Run, optional
        Threads to use, and who receives the progress.

    """
    course = _Course(pyramid, axes, bound)
    starts = list(range(min(pyramid.coarsest, _COARSEST_START), 0, -2))[::-1] or [0]
    entries = course.started(starts[:2], run.part(0.0, 0.15))
    if may_rest and all(is_spot(e.kernel) and e.level == 0 for e in _last(entries)):
        run.report(1.0, "the photo is not shaken")
        return Finish(_last(entries)[0], 0.0, 1.0, at_rest=True)
    entries += course.started(starts[2:], run.part(0.15, 0.5))
    chances = course.chances(entries, entries)
    order = [entries[i] for i in np.argsort(-chances, kind="stable")]
    winner = order[0]
    if not quick:
        best = dict.fromkeys(entry.start for entry in order)
        ends = _last(entries)
        taken = [e for e in ends if e.start in list(best)[:_REFINED]]
        taken = [e for e in taken if not is_spot(e.kernel)] or taken
        finals = course.refined(taken, run.part(0.5, 0.85))
        finals += [e for e in entries if e.start in {one.start for one in taken}]
        entries += finals
        chances = course.chances(finals, entries)
        compared = np.argsort(-chances, kind="stable")[:_COMPARED]
        finals, chances = [finals[i] for i in compared], chances[compared]
        compare = course.side_by_side
        margins = compare(finals)
        if margins.max() < _SILENT:
            finals, compare = entries, course.by_sharpness
            chances = _AGREEMENT_WORTH * np.array([_nearest(entry, entries) for entry in entries])
            margins = compare(entries)
        winner = course.polished(finals[int(np.argmax(chances + margins))], ends, compare)
    margin = float(course.margins([winner])[0])
    run.report(1.0, "kernel estimated")
    return Finish(winner, margin, _nearest(winner, entries), at_rest=False)


class _Course:
    """The photo and the settings that all steps of a race share."""

    def __init__(
        self,
        pyramid: Pyramid,
        axes: Axes,
        bound: float | None,
    ) -> None:
        self.pyramid = pyramid
        self.axes = (axes[0], axes[1], axes[2] and not pyramid.camera.is_uniform)
        self.bound = bound

    def started(self, starts: Sequence[int], run: Run) -> list[Entry]:
        """Run candidates to their finest scales; return the kernels of their last scales."""
        entries: list[Entry] = []
        for done, (_, new) in enumerate(in_order(self._started, starts, run), 1):
            entries += new
            run.report(done / len(starts), "starts")
        return entries

    def chances(self, entries: Sequence[Entry], known: Sequence[Entry]) -> NDArray[np.float64]:
        """Return the score of each kernel: its margin, and its agreement with the known kernels."""
        alike = np.array([_nearest(entry, known) for entry in entries])
        collapsed = np.array([is_spot(entry.kernel) for entry in entries])
        chances: NDArray[np.float64] = (
            self.margins(entries) + _AGREEMENT_WORTH * alike - _COLLAPSED * collapsed
        )
        return chances

    def refined(self, entries: Sequence[Entry], run: Run) -> list[Entry]:
        """Refine kernels, with roll and without."""
        uniform = self.pyramid.camera.is_uniform
        ways = (_REFINEMENT, _UNIFORM_REFINEMENT) if uniform else (_REFINEMENT,)
        jobs = [(entry, how, self.axes) for entry in entries for how in ways]
        if self.axes[2]:
            flat = (self.axes[0], self.axes[1], False)
            jobs += [(entry, how, flat) for entry in entries for how in ways]
        results = []
        work = in_order(lambda job: self._refined(*job), jobs, run)
        for done, (_, entry) in enumerate(work, 1):
            results.append(entry)
            run.report(done / len(jobs), "refinement")
        return results

    def margins(self, entries: Sequence[Entry]) -> NDArray[np.float64]:
        """Return the margins of kernels, each at the scale where it is a few pixels wide.

        At that scale a kernel that is too narrow gains nothing, and one that is too wide loses.
        The width of other kernels has no influence on the scale.
        """
        levels = np.array([self._level(_width(entry), _OWN_WIDTH) for entry in entries])
        margins = np.empty(len(entries))
        for level in np.unique(levels):
            at = np.flatnonzero(levels == level)
            margins[at] = self._judged([entries[int(i)] for i in at], int(level))
        return margins

    def side_by_side(self, entries: Sequence[Entry]) -> NDArray[np.float64]:
        """Return the margins of kernels at one scale that resolves most of them well."""
        return self._compared(entries, _WIDE, self._judged)

    def by_sharpness(self, entries: Sequence[Entry]) -> NDArray[np.float64]:
        """Return scores of kernels at one scale by the sharpness of the restored picture.

        This is for photos whose energy shows no difference between kernels. In fine texture the
        true kernel may lose some margin, so a loss counts only up to a bound.
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
        """Return scores of kernels at the scale that a quantile of their widths sets."""
        widths = np.array([_width(entry) for entry in entries])
        level = self._level(float(np.quantile(widths, quantile)), _COMMON_WIDTH)
        shrink = self.pyramid.at(level).camera.width / self.pyramid.camera.width
        compared = np.full(len(entries), -1.0)
        fits = np.flatnonzero(widths * shrink <= _WIDEST)
        if len(fits):
            compared[fits] = scores([entries[int(i)] for i in fits], level)
        return compared - _COLLAPSED * np.array([is_spot(entry.kernel) for entry in entries])

    def _level(self, width: float, wanted: float) -> int:
        """Return the scale that reduces a width in pixels of the photo to the wanted width."""
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
        """Try other edges and thin paths for the winner; return the best kernel of them all."""
        source = next(entry for entry in sources if entry.start == winner.start)
        flat = not winner.kernel.theta[:, 2].any()
        axes = (self.axes[0], self.axes[1], self.axes[2] and not flat)
        other = self._refined(source, _OTHER_REFINEMENT, axes)
        path = self._refined(_thin(winner, _WIDE_PATH), _PATH_REFINEMENT, axes)
        entries = [winner, _thin(winner), other, _thin(other), path, _thin(path)]
        return entries[int(np.argmax(compare(entries)))]

    def _started(self, start: int) -> list[Entry]:
        """Run one start to its finest scale; return the kernels of its last scales."""
        candidate = Candidate(self.pyramid, start, axes=self.axes, bound=self.bound)
        entries = []
        while candidate.advance():
            name = f"start {start}, scale {candidate.level}"
            entries.append(Entry(name, start, candidate.level, candidate.kernel))
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
    """Return the width of a kernel in pixels of the photo."""
    return heaviest(entry.kernel, _FAINT).extent_px()


def _nearest(entry: Entry, known: Sequence[Entry]) -> float:
    """Return the mean agreement of a kernel with the nearest kernels of other starts."""
    others = [one.kernel for one in known if one.start != entry.start]
    alike = sorted((agreement(entry.kernel, other) for other in others), reverse=True)
    return float(np.mean(alike[:_AGREEING] or [0.0]))


def _thin(entry: Entry, width: float = 1.0) -> Entry:
    """Reduce a kernel to a thin path."""
    return entry._replace(name=f"{entry.name}, thin", kernel=thinned(entry.kernel, width))


def _last(entries: Sequence[Entry]) -> list[Entry]:
    """Return the last kernel of every start."""
    return list({entry.start: entry for entry in entries}.values())
