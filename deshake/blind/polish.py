"""Polish kernels: refine a path through each again and again, as long as the score rises.

Refinement alone gets stuck: a kernel that is too wide gives a latent picture that is too
sharp, and the two fit each other. Reduced to a thin path, or to a smooth path that matches the
spectra of the photo, a kernel that is nearly right leaves this state and comes nearer to the truth;
a wrong one seldom gains. A kernel that is wide for the frame sees few edges in tiles. So it is also
refined on the whole frame (`wide_start`), and at the end of the race once more.

Last, paths are traced closely along the best kernel, and moved to where they match the spectra of
finer scales, too. The spectra of one scale come from few tiles, and a path of many control points
would fit their noise.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from deshake.blind.growth import on_frame
from deshake.blind.settings import SETTINGS
from deshake.operators.strips import reported

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from deshake.blind.candidate import Axes
    from deshake.blind.entry import Entry
    from deshake.blind.judge import Judge
    from deshake.blind.kernel_comparison import Comparison
    from deshake.run import Run

__all__ = ["Polished", "polished", "polished_on_frame"]

_S: Final = SETTINGS.polish


class Polished(NamedTuple):
    """A polished kernel, and the judge that preferred it.

    The kernel may be wider than the one that the polish began with. Then another scale suits it,
    and its margin differs there from the one that counted.
    """

    entry: Entry
    judge: Judge


def polished(
    comparison: Comparison,
    best: Sequence[Entry],
    sources: Sequence[Entry],
    axes: Axes,
    run: Run,
) -> list[Polished]:
    """Polish kernels of distinct starts for one round, and the best of them for all rounds.

    Parameters
    ----------
    comparison : Comparison
        The photo, and the judge of its kernels.
    best : sequence of Entry
        The kernels.
    sources : sequence of Entry
        The last kernel of each start before any refinement.
    axes : three bools
        The axes that the camera may turn about.
    run : Run
        Threads to use, and who receives the progress.

    Returns
    -------
    list of Polished
        The best kernel of each of these starts, the best first. It is the given one if none is
        better.

    """
    others = {source.start: source for source in sources}
    lines = [_Line(comparison, entry, others[entry.start], axes) for entry in best]
    first, *rest = run.parts([len(lines), *[1] * (_S.rounds - 1 + _S.tracings)])
    later, tracing = rest[: _S.rounds - 1], rest[_S.rounds - 1 :]
    _advance(comparison, lines, first)
    ranked = np.argsort(-comparison.scores([line.best for line in lines]), kind="stable")
    best_of_all = comparison.foremost([lines[i].best for i in ranked])[0]
    leader = next(line for line in lines if line.best is best_of_all)
    for part in later:
        _advance(comparison, [leader], part)
    leader.trace()
    for part in tracing:
        _advance(comparison, [leader], part)
    ordered = [leader, *(line for line in lines if line is not leader)]
    return [Polished(line.best, line.judge) for line in ordered]


def polished_on_frame(comparison: Comparison, entry: Entry, axes: Axes, run: Run) -> Entry:
    """Refine a kernel that is wide for the frame on the whole frame, as long as its score rises.

    Parameters
    ----------
    comparison : Comparison
        The photo, and the judge of its kernels.
    entry : Entry
        The kernel.
    axes : three bools
        The axes that the camera may turn about.
    run : Run
        Threads to use, and who receives the progress.

    Returns
    -------
    Entry
        The best kernel; the given one if none is better.

    """
    level, best = comparison.level(entry), entry
    for part in run.parts([1] * _S.rounds):
        refined = partial(on_frame, comparison, best, comparison.pyramid, axes=axes)
        work = reported(refined, _S.last_frame, part, "refinement")
        new = [one for _, one in work if one is not None and comparison.is_wide(one)]
        own, *scores = comparison.scores_at(level, [best, *new]).tolist()
        if not scores or max(scores) <= own:
            break
        best = new[int(np.argmax(scores))]
    return best if best is entry else best._replace(name=f"{entry.name}, frame")


class _Line:
    """A kernel, its score, and whether the last round raised it.

    Parameters
    ----------
    comparison : Comparison
        The photo, and the judge of its kernels.
    entry : Entry
        The kernel to begin with.
    source : Entry
        The last kernel of its start before any refinement; only the first round uses it.
    axes : three bools
        The axes that the camera may turn about.

    """

    def __init__(self, comparison: Comparison, entry: Entry, source: Entry, axes: Axes) -> None:
        self.comparison = comparison
        self.judge = comparison.judge(entry)
        self.axes = (axes[0], axes[1], axes[2] and entry.rolls)
        self.name = f"{entry.name}, polished"
        self.best = entry
        self.source: Entry | None = source
        self.score = float(_scores(comparison, [(self, entry)])[0])
        self.rises = True
        self.tracing = False

    def trace(self) -> None:
        """Go over to paths that are traced closely along the kernel."""
        self.rises = self.tracing = True

    def ways(self) -> list[Callable[[], list[Entry]]]:
        """Return the ways to kernels that may be better; none depends on another."""
        if self.tracing:
            return [self._traced]
        ways = [self._thin, self._smooth, self._weighed]
        if self.source is None:
            return ways
        if self.comparison.is_wide(self.best):
            ways.append(self._on_frame)
        return [partial(self._from, self.source), *ways]

    def take(self, scored: Sequence[tuple[float, Entry]]) -> None:
        """Replace the kernel by the best of others, if its score is higher."""
        self.source = None
        score, entry = max(scored, key=lambda one: one[0], default=(self.score, self.best))
        self.rises = score > self.score
        if self.rises:
            self.best, self.score = entry._replace(name=self.name), score

    def _thin(self) -> list[Entry]:
        thin = self.best.thin()
        refined = thin.refined(self.comparison.pyramid, _S.thin, self.axes)
        return [refined] if self.source is None else [refined, thin]

    def _smooth(self) -> list[Entry]:
        smooth = self.comparison.matched(self.best)
        return [smooth.refined(self.comparison.pyramid, _S.smooth, self.axes), smooth]

    def _traced(self) -> list[Entry]:
        paths = self.comparison.traced(self.best)
        last = [path.refined(self.comparison.pyramid, _S.smooth, self.axes) for path in paths[-1:]]
        return [*paths, *last]

    def _on_frame(self) -> list[Entry]:
        pyramid = self.comparison.pyramid
        new = [on_frame(self.comparison, self.best, pyramid, way, self.axes) for way in _S.frame]
        wide = [entry for entry in new if entry is not None]
        wide += [entry.refined(pyramid, _S.smooth, self.axes) for entry in wide]
        return [entry for entry in wide if self.comparison.is_wide(entry)]

    def _weighed(self) -> list[Entry]:
        return [self.comparison.weighed(self.best)]

    def _from(self, source: Entry) -> list[Entry]:
        refined = source.refined(self.comparison.pyramid, _S.other_edges, self.axes)
        return [refined, refined.thin()]


def _advance(comparison: Comparison, lines: Sequence[_Line], run: Run) -> None:
    """Replace the kernels of lines by the best refinements of them, where the score rises."""
    rising = [line for line in lines if line.rises]
    jobs = [(line, way) for line in rising for way in line.ways()]
    pairs: list[tuple[_Line, Entry]] = []
    for (line, _), new in reported(lambda job: job[1](), jobs, run, "refinement"):
        pairs += [(line, entry) for entry in new]
    scored = list(zip(_scores(comparison, pairs).tolist(), pairs, strict=True))
    for line in rising:
        line.take([(score, entry) for score, (other, entry) in scored if other is line])


def _scores(comparison: Comparison, pairs: Sequence[tuple[_Line, Entry]]) -> NDArray[np.float64]:
    """Return the scores of kernels, each by the judge of its line, if that has room for it."""
    scores = np.full(len(pairs), -SETTINGS.kernel_comparison.penalty)
    fits = [
        not comparison.hopeless(entry) and line.judge.has_room(entry.kernel)
        for line, entry in pairs
    ]
    held = [(entry, line.judge) for (line, entry), fit in zip(pairs, fits, strict=True) if fit]
    scores[fits] = comparison.scores_by(held)
    return scores
