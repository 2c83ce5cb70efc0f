"""The means of every long computation: its threads, and the receiver of its progress."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["Progress", "Run", "available_threads"]


class Progress(Protocol):
    """Receives the share of the work that is done, 0..1, and the present step in words."""

    def __call__(self, share: float, text: str, /) -> None:
        """Receive a report."""
        ...


@dataclass(frozen=True)
class Run:
    """The threads of a long computation, and the receiver of its progress. No result depends on it.

    Parameters
    ----------
    threads : int, optional
        Threads to use, >= 1; by default one for each processor.
    progress : callable, optional
        Receives the share of the work that is done, 0..1, and a text. By default nobody does.

    """

    threads: int | None = None
    progress: Progress | None = None

    @property
    def workers(self) -> int:
        """Number of threads to use."""
        return self.threads or available_threads()

    def report(self, share: float, text: str) -> None:
        """Report the share of the work that is done, 0..1, and the present step in words."""
        if self.progress is not None:
            self.progress(share, text)

    def part(self, start: float, end: float) -> Run:
        """Return the run of a step: its shares 0..1 are the shares start..end of this run.

        The end is reported exactly, so that a last step ends at 1.
        """

        def report_part(share: float, text: str) -> None:
            self.report(end if share >= 1 else min(end, start + (end - start) * share), text)

        return self._reporting_to(report_part)

    def parts(self, efforts: Sequence[float]) -> list[Run]:
        """Return the runs of successive steps, with durations in proportion to efforts >= 0."""
        ends = list(accumulate(efforts, initial=0.0))
        return [self.part(start / ends[-1], end / ends[-1]) for start, end in pairwise(ends)]

    def rising(self) -> Run:
        """Return a run that never reports less than it reported before."""
        highest = 0.0

        def report_highest(share: float, text: str) -> None:
            nonlocal highest
            highest = max(highest, share)
            self.report(highest, text)

        return self._reporting_to(report_highest)

    def silent(self) -> Run:
        """Return a run with the same threads that reports nothing."""
        return replace(self, progress=None)

    def _reporting_to(self, progress: Progress) -> Run:
        """Return a run that reports to another callable, if this one has a receiver."""
        return self if self.progress is None else replace(self, progress=progress)


def available_threads() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
