"""Polish kernels: refine a thin path of each again and again, as long as the judge's margin rises.

Refinement alone gets stuck: a kernel that is too wide gives a latent picture that is too sharp, and
the two fit each other. Reduced to a thin path, a kernel that is nearly right leaves this
state and comes nearer to the truth; a wrong one seldom gains. So the margins after the polish
separate right from wrong kernels better than those before it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deshake.blind.candidate import Refinement
from deshake.blind.kernel_comparison import COLLAPSED, Comparison
from deshake.blind.spot import is_spot
from deshake.geometry.rotations import reach
from deshake.operators.strips import in_order

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.candidate import Axes
    from deshake.blind.entry import Entry
    from deshake.blind.judge import Judge
    from deshake.run import Run
    from deshake.signal.pyramid import Pyramid

__all__ = ["polished"]

_OTHER_EDGES = Refinement(1e-2)  # price in squared contrast: fewer edges, from the same start
_PATHS = (  # grid steps: width of the neighbourhood on a thin path; refinement of that path
    (1.4, Refinement(2e-3, iterations=4, cut=0.01, room=False)),
    (1.4, Refinement(1e-3, iterations=4, cut=0.01, room=False)),
    (1.0, Refinement(2e-3, iterations=4)),
)
_STARTS = 2  # number of starts whose best kernel is polished
_ROUNDS_EACH = 2  # number of rounds for each start
_ROUNDS = 4  # number of rounds for the better start; a line whose margin does not rise ends earlier


@dataclass
class _Line:
    """The best kernel of a start so far, its margin, and whether the last round raised it."""

    best: Entry
    margin: float
    rises: bool = True

    def __post_init__(self) -> None:
        self.name = f"{self.best.name}, polished"


def polished(
    pyramid: Pyramid,
    ranked: Sequence[Entry],
    sources: Sequence[Entry],
    axes: Axes,
    run: Run,
) -> list[Entry]:
    """Polish the best kernels of two starts; only the better one gets all rounds.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    ranked : sequence of Entry
        Kernels, the best first.
    sources : sequence of Entry
        The last kernel of each start before any refinement.
    axes : three bools
        The axes that the camera may turn about.
    run : Run
        Threads to use, and who receives the progress.

    """
    best: dict[int, Entry] = {}
    for entry in ranked:
        best.setdefault(entry.start, entry)
    entries = list(best.values())[:_STARTS]
    polish = _Polish(pyramid, axes, Comparison(pyramid).judge(entries))
    lines = [_Line(entry, polish.margin(entry)) for entry in entries]
    others = {entry.start: [(entry, _OTHER_EDGES)] for entry in sources}
    parts = iter(run.parts([1.0] * (_ROUNDS_EACH * (len(lines) - 1) + _ROUNDS)))
    for line in lines:
        polish.advance(line, others[line.best.start], next(parts))
        for _ in range(_ROUNDS_EACH - 1):
            polish.advance(line, [], next(parts))
    leader = max(lines, key=lambda line: line.margin)
    for part in parts:
        polish.advance(leader, [], part)
    return [line.best for line in lines]


class _Polish:
    """The photo, the axes that the camera may turn about, and the judge of all kernels."""

    def __init__(self, pyramid: Pyramid, axes: Axes, judge: Judge) -> None:
        self.pyramid = pyramid
        self.axes = axes
        self.judge = judge

    def advance(self, line: _Line, others: Sequence[tuple[Entry, Refinement]], run: Run) -> None:
        """Replace the best kernel of a line by the best refinement, if the margin rises."""
        if not line.rises:
            return
        axes = (self.axes[0], self.axes[1], self.axes[2] and line.best.rolls)
        jobs = [*others, *((line.best.thin(width), how) for width, how in _PATHS)]
        new = []
        work = in_order(lambda job: job[0].refined(self.pyramid, job[1], axes), jobs, run)
        for done, (_, entry) in enumerate(work, 1):
            new.append(entry)
            run.report(done / len(jobs), "refinement")
        if others:
            new += [line.best.thin(), new[0].thin()]
        margins = [self.margin(entry) for entry in new]
        top = int(np.argmax(margins))
        line.rises = margins[top] > line.margin
        if line.rises:
            line.best, line.margin = new[top]._replace(name=line.name), margins[top]

    def margin(self, entry: Entry) -> float:
        """Return the margin; `-COLLAPSED` for a spot, or without room for the kernel."""
        kernel = entry.kernel.for_camera(self.judge.tiles.camera)
        if is_spot(entry.kernel) or reach(kernel.camera, kernel.theta) > self.judge.tiles.far:
            return -COLLAPSED
        return entry.margin(self.judge)
