"""A kernel in the race: where it comes from, and what the race makes of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from deshake.blind.agreement import agreement
from deshake.blind.camera_path import thinned
from deshake.blind.candidate import refined
from deshake.blind.settings import SETTINGS
from deshake.blind.trimming import heaviest
from deshake.operators.strips import reported

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.candidate import Axes
    from deshake.blind.judge import Judge
    from deshake.blind.settings import Refinement
    from deshake.geometry.kernel import RotationKernel
    from deshake.run import Run
    from deshake.signal.pyramid import Pyramid

__all__ = ["Entry", "all_refined", "best_of_starts", "last_of_starts", "nearest"]

_S: Final = SETTINGS.entry


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

    @property
    def width(self) -> float:
        """Width of the kernel in pixels of the photo."""
        return heaviest(self.kernel, _S.faint).extent_px()

    def keeps(self, bound: float | None) -> bool:
        """Return whether the kernel is at most `bound` pixels of the photo wide; None: no bound."""
        return bound is None or self.kernel.extent_px() <= bound

    @property
    def rolls(self) -> bool:
        """Whether the camera turns about its optical axis."""
        turn = np.ptp(self.kernel.theta[:, 2])
        return bool(turn > _S.least_roll * self.kernel.steps[2])

    def margin(self, judge: Judge) -> float:
        """Return the margin of the kernel, less a price if it has roll."""
        return judge.margin(self.kernel) - _S.roll_worth * self.rolls

    def zoomed(self, ratio: float) -> Entry:
        """Take the kernel for a focal length `ratio` times as long."""
        return self if ratio == 1 else self._replace(kernel=self.kernel.zoomed(ratio))

    def thin(self) -> Entry:
        """Reduce the kernel to a thin path."""
        return self._replace(name=f"{self.name}, thin", kernel=thinned(self.kernel))

    def refined(self, pyramid: Pyramid, how: Refinement, axes: Axes) -> Entry:
        """Refine the kernel at its scale, unless it is a point there."""
        camera = pyramid.camera_at(self.level)
        if self.kernel.for_camera(camera).extent_px() < _S.least_width:
            return self
        kernel = refined(pyramid, self.kernel, self.level, how, axes=axes)
        flat = "" if axes[2] else ", no roll"
        return self._replace(name=f"{self.name}, refined at {how.price:g}{flat}", kernel=kernel)


def all_refined(
    pyramid: Pyramid, jobs: Sequence[tuple[Entry, Refinement, Axes]], run: Run
) -> list[Entry]:
    """Refine kernels, each in its way and about its axes."""
    work = reported(lambda job: job[0].refined(pyramid, *job[1:]), jobs, run, "refinement")
    return [entry for _, entry in work]


def best_of_starts(ranked: Sequence[Entry]) -> list[Entry]:
    """Return the best kernel of every start; the given kernels are sorted, the best first."""
    best: dict[int, Entry] = {}
    for entry in ranked:
        best.setdefault(entry.start, entry)
    return list(best.values())


def last_of_starts(entries: Sequence[Entry]) -> list[Entry]:
    """Return the last kernel of every start."""
    return list({entry.start: entry for entry in entries}.values())


def nearest(entry: Entry, known: Sequence[Entry]) -> float:
    """Return the mean agreement of a kernel with the nearest kernels of other starts, 0..1.

    Parameters
    ----------
    entry : Entry
        The kernel.
    known : sequence of Entry
        All kernels.

    """
    others = [one.kernel for one in known if one.start != entry.start]
    alike = sorted((agreement(entry.kernel, other) for other in others), reverse=True)
    return float(np.mean(alike[: _S.agreeing] or [0.0]))
