"""Strips of patches and bands of rows: the pieces that work is cut into and threads share.

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

__all__ = ["Strip", "bands", "in_order", "reported", "with_halo"]

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


def reported(
    work: Callable[[S], T], strips: Sequence[S], run: Run, text: str
) -> Iterator[tuple[S, T]]:
    """Yield as `in_order` does, and report the share of the pieces that are done."""
    for done, result in enumerate(in_order(work, strips, run), 1):
        run.report(done / len(strips), text)
        yield result


def bands(length: int, step: int) -> list[slice]:
    """Cut rows, or another range, into bands of `step` each; the last one may be narrower."""
    return [slice(first, min(first + step, length)) for first in range(0, length, step)]


def with_halo(band: slice, halo: int, length: int) -> tuple[slice, slice]:
    """Return a band with up to `halo` more on both sides, and the place of the band in it."""
    first, last = max(band.start - halo, 0), min(band.stop + halo, length)
    return slice(first, last), slice(band.start - first, band.stop - first)


@cache
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """Keep one pool of each size; a forked process needs its own."""
    return ThreadPoolExecutor(threads, f"deshake-{process}")
