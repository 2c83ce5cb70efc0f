"""Work in other processes, and what it costs in time and memory."""

from __future__ import annotations

import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from multiprocessing.connection import Connection

__all__ = ["RUSAGE_UNIT", "Cost", "apart", "completed", "fastest", "measured", "peak_bytes"]

Key = TypeVar("Key")

RUSAGE_UNIT = 1 if sys.platform == "darwin" else 1024  # bytes, of ru_maxrss


class Cost(NamedTuple):
    """Seconds by the clock and of the processor, and the peak memory of the process (GB)."""

    seconds: float
    cpu: float
    peak_gb: float


def peak_bytes() -> int:
    """Return the most memory that this process has had, its libraries included."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * RUSAGE_UNIT


def measured(work: Callable[[], Any]) -> tuple[Any, Cost]:
    """Do some work; return its result and its cost."""
    start, start_cpu = time.perf_counter(), time.process_time()
    result = work()
    seconds, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    return result, Cost(seconds, cpu, peak_bytes() / 1e9)


def fastest(works: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Time every work in turn, again and again; return the shortest time of each, in seconds."""
    best = dict.fromkeys(works, float("inf"))
    for _ in range(repeats):
        for name, work in works.items():
            start = time.perf_counter()
            work()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def apart(function: Callable[..., Any], *args: Any) -> Any:  # noqa: ANN401
    """Call a function in a process of its own; raise what it raises."""
    context = get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(theirs, function, args))
    process.start()
    theirs.close()
    try:
        answer = ours.recv()
    except EOFError:
        answer = RuntimeError("its process was killed")
    process.join()
    if isinstance(answer, Exception):
        raise answer
    return answer


def _send(pipe: Connection, function: Callable[..., Any], args: Sequence[Any]) -> None:
    """Send what a function returns, or its exception."""
    try:
        pipe.send(function(*args))
    except Exception as error:  # noqa: BLE001 - the other process raises it
        pipe.send(error)
    pipe.close()


def completed(
    function: Callable[..., Any], tasks: Mapping[Key, Sequence[Any]], jobs: int
) -> Iterator[tuple[Key, Any]]:
    """Call a function with the arguments of each task, some at once; yield results as they come."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        works = {pool.submit(function, *args): key for key, args in tasks.items()}
        for work in as_completed(works):
            yield works[work], work.result()
