"""Strips of patches and bands of rows: the pieces of work that threads share.

There is one pool of threads of each size. Results come back in the order of the strips, so that
sums over strips do not depend on the number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from concurrent.futures import Future

    from deshake.run import Run

__all__ = ["Strip", "in_order", "row_bands"]

S = TypeVar("S")
T = TypeVar("T")


@dataclass(frozen=True)
class Strip:
    """Neighbouring patches of one row: columns first .. last - 1 of row `row`."""

    row: int
    first: int
    last: int

    @property
    def count(self) -> int:
        """Number of patches."""
        return self.last - self.first

    def part(self, first: int, last: int) -> Strip:
        """Return the patches first .. last - 1 of this strip."""
        return Strip(self.row, self.first + first, self.first + last)


def in_order(work: Callable[[S], T], strips: Sequence[S], run: Run) -> Iterator[tuple[S, T]]:
    """Yield `work` of every strip, or other piece, in order, with a few under way at once."""
    threads = run.workers
    if threads == 1 or len(strips) == 1:
        for strip in strips:
            yield strip, work(strip)
        return
    pool = _pool(threads, os.getpid())
    waiting: deque[tuple[S, Future[T]]] = deque()
    try:
        for strip in strips:
            waiting.append((strip, pool.submit(work, strip)))
            if len(waiting) > 2 * threads:
                done, future = waiting.popleft()
                yield done, future.result()
        while waiting:
            done, future = waiting.popleft()
            yield done, future.result()
    finally:
        for _, future in waiting:
            future.cancel()


def row_bands(height: int, step: int) -> list[slice]:
    """Cut rows into bands of `step` rows; the last one may be narrower."""
    return [slice(top, min(top + step, height)) for top in range(0, height, step)]


@cache
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """Keep one pool of each size; a forked process needs its own."""
    return ThreadPoolExecutor(threads, f"deshake-{process}")
