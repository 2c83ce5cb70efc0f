"""Polish kernels: refine a path through each again and again, as long as the score rises.

Refinement alone gets stuck: a kernel that is too wide gives a latent picture that is too
sharp, and the two fit each other. Reduced to a thin path, or to a smooth path that matches the
spectra of the photo, a kernel that is nearly right leaves this state and comes nearer to the truth;
a wrong one seldom gains.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.entry import all_refined, best_of_starts
from deshake.blind.settings import SETTINGS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.candidate import Axes
    from deshake.blind.entry import Entry
    from deshake.blind.kernel_comparison import Comparison
    from deshake.run import Run

__all__ = ["polished"]

_S: Final = SETTINGS.polish


def polished(
    comparison: Comparison,
    ranked: Sequence[Entry],
    sources: Sequence[Entry],
    axes: Axes,
    run: Run,
) -> Entry:
    """Polish the best kernels of two starts for one round, and the better one for all rounds.

    Parameters
    ----------
    comparison : Comparison
        The photo, and the judge of its kernels.
    ranked : sequence of Entry
        Kernels, the best first.
    sources : sequence of Entry
        The last kernel of each start before any refinement.
    axes : three bools
        The axes that the camera may turn about.
    run : Run
        Threads to use, and who receives the progress.

    Returns
    -------
    Entry
        The best kernel. It is one of the given ones if none is better.

    """
    others = {source.start: source for source in sources}
    lines = [_Line(comparison, entry, axes) for entry in best_of_starts(ranked)[: _S.lines]]
    parts = iter(run.parts([1.0] * (len(lines) + _S.rounds - 1)))
    for line in lines:
        line.advance(next(parts), others[line.best.start])
    leader = lines[int(np.argmax(comparison.scores([line.best for line in lines])))]
    for part in parts:
        leader.advance(part)
    return leader.best


class _Line:
    """A kernel, its score, and whether the last round raised it."""

    def __init__(self, comparison: Comparison, entry: Entry, axes: Axes) -> None:
        self.comparison = comparison
        self.judge = comparison.judge(entry)
        self.axes = (axes[0], axes[1], axes[2] and entry.rolls)
        self.name = f"{entry.name}, polished"
        self.best = entry
        self.score = self._score(entry)
        self.rises = True

    def advance(self, run: Run, source: Entry | None = None) -> None:
        """Replace the kernel by the best refinement of it or its source, if the score rises."""
        if not self.rises:
            return
        thin, smooth = self.best.thin(), self.comparison.matched(self.best)
        jobs = [(thin, _S.thin, self.axes), (smooth, _S.smooth, self.axes)]
        if source is not None:
            jobs.append((source, _S.other_edges, self.axes))
        new = all_refined(self.comparison.pyramid, jobs, run)
        if source is not None:
            new += [thin, new[-1].thin()]
        new += [smooth, self.comparison.weighed(self.best)]
        scores = [self._score(entry) for entry in new]
        top = int(np.argmax(scores))
        self.rises = scores[top] > self.score
        if self.rises:
            self.best, self.score = new[top]._replace(name=self.name), scores[top]

    def _score(self, entry: Entry) -> float:
        """Return the score of a kernel; one that the judge has no room for has none."""
        if self.comparison.hopeless(entry) or not self.judge.has_room(entry.kernel):
            return -SETTINGS.kernel_comparison.penalty
        return self.comparison.score(entry, self.judge)
