"""Many photos at once, each in a process of its own, within the limits of processors and memory.

If a process crashes or is killed, only its own photo fails. A new process takes its place.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import sys
from collections import deque
from multiprocessing import connection, forkserver, get_context, resource_tracker
from typing import TYPE_CHECKING, Self

from deshake.batch.footprint import memory_needed
from deshake.batch.memory import gigabytes
from deshake.batch.task import Result, failure
from deshake.batch.worker import LogLevels, LogMessage, ProgressMessage, serve
from deshake.errors import DeshakeError, PhotoError
from deshake.files.part_files import remove_stale_parts

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence
    from multiprocessing.connection import Connection
    from multiprocessing.context import BaseContext
    from multiprocessing.process import BaseProcess

    from deshake.batch.memory import Budget
    from deshake.batch.plan import Job
    from deshake.batch.work import Work

__all__ = ["run_in_processes"]

_log = logging.getLogger(__name__)

_GRACE = 3.0
"""Seconds for a process to remove its unfinished outputs, after the request to end."""


def run_in_processes(
    jobs: Sequence[Job],
    work: Work,
    *,
    processes: int,
    threads: int,
    budget: Budget,
    progress: Callable[[int, float, str], None],
) -> Generator[tuple[int, Result], None, None]:
    """Do the work on many photos; yield the number and the result of each photo when it ends.

    Photos start in their order. A photo starts as soon as a process is free and its expected
    memory fits beside that of the others. Closing the iterator ends all processes.

    Parameters
    ----------
    jobs : sequence of Job
        The photos.
    work : Work
        The work to do with them.
    processes : int
        Largest number of photos at once.
    threads : int
        Threads in each process.
    budget : Budget
        Memory of all processes together.
    progress : callable
        Receives the number of a job, the share of it that is done, 0..1, and a text.

    """
    waiting = deque(enumerate(jobs))
    taken: dict[int, int] = {}
    with _Pool(work, threads) as pool:
        while waiting or taken:
            while waiting and len(taken) < processes:
                number, job = waiting[0]
                need = memory_needed(job, work, threads)
                if not budget.admits(need, taken.values()):
                    pool.dismiss()
                    break
                waiting.popleft()
                try:
                    budget.check(need, job)
                except DeshakeError as error:
                    yield number, failure(job, error)
                    continue
                if need > budget.limit:
                    _log.warning(
                        "%s: needs about %s of memory, and only %s are free: it is worked on alone",
                        job.source,
                        gigabytes(need),
                        gigabytes(budget.limit),
                    )
                pool.start(number, job)
                taken[number] = need
            if not taken:
                continue  # every waiting photo was refused
            for number, message in pool.messages():
                if isinstance(message, ProgressMessage):
                    progress(number, message.share, message.text)
                    continue
                del taken[number]
                yield number, message


class _Worker:
    """A process, and this end of the pipe to it."""

    def __init__(self, context: BaseContext, work: Work, threads: int) -> None:
        self.pipe: Connection
        self.pipe, other = context.Pipe()
        self.process: BaseProcess = context.Process(  # type: ignore[attr-defined]
            target=serve, args=(other, work, threads, LogLevels.here()), daemon=True
        )
        self.process.start()
        other.close()
        self.number = -1
        self.job: Job | None = None

    def begin(self, number: int, job: Job) -> None:
        """Start a job. If the process has ended, `messages` reports it later."""
        self.number, self.job = number, job
        with contextlib.suppress(OSError):
            self.pipe.send(job)


class _Pool:
    """The processes, as a context manager that ends all of them."""

    def __init__(self, work: Work, threads: int) -> None:
        self._work = work
        self._threads = threads
        self._idle: list[_Worker] = []
        self._busy: dict[Connection, _Worker] = {}
        # A server that has loaded all modules forks a process at once. On other systems than Linux,
        # forking is not safe with the system's libraries.
        self._context: BaseContext
        if sys.platform == "linux":
            self._context = get_context("forkserver")
            self._context.set_forkserver_preload(
                ["deshake.batch.worker", "deshake.batch.restoration_work"]
            )
            _start_server()
        else:
            self._context = get_context("spawn")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        workers = [*self._idle, *self._busy.values()]
        for worker in workers:
            worker.process.terminate()
        for worker in workers:
            worker.process.join(_GRACE)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
            worker.pipe.close()
            _clear(worker.job)

    def dismiss(self) -> None:
        """End the idle processes: they may still hold memory of finished photos."""
        for worker in self._idle:
            worker.pipe.close()
            worker.process.join()
        self._idle.clear()

    def start(self, number: int, job: Job) -> None:
        """Give a job to a process that is free, or to a new one."""
        worker = (
            self._idle.pop() if self._idle else _Worker(self._context, self._work, self._threads)
        )
        self._busy[worker.pipe] = worker
        worker.begin(number, job)

    def messages(self) -> Iterator[tuple[int, ProgressMessage | Result]]:
        """Wait for messages of the processes; log each `LogMessage`, and yield the others."""
        for pipe in connection.wait(list(self._busy)):
            worker = self._busy[pipe]  # type: ignore[index]
            try:
                message: ProgressMessage | LogMessage | Result = worker.pipe.recv()
            except (EOFError, OSError):
                yield worker.number, self._lost(worker)
                continue
            if isinstance(message, LogMessage):
                logging.getLogger(message.name).log(message.level, "%s", message.text)
                continue
            if isinstance(message, Result):
                worker.job = None
                self._idle.append(self._busy.pop(worker.pipe))
            yield worker.number, message

    def _lost(self, worker: _Worker) -> Result:
        """Return the result of the job whose process has ended."""
        job = worker.job
        assert job is not None  # noqa: S101 - it is among the busy ones
        del self._busy[worker.pipe]
        worker.pipe.close()
        worker.process.join()
        _clear(job)
        code = worker.process.exitcode or 0
        return failure(job, _crash(code, job))


def _start_server() -> None:
    """Start the server that forks processes; it ignores interrupts from the keyboard."""
    resource_tracker.ensure_running()  # the server needs it, and it unblocks interrupts
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _crash(code: int, job: Job) -> PhotoError:
    """Return the error for a process that ended in the middle of a photo."""
    if code == -signal.SIGKILL:
        return PhotoError(
            "its process was killed, probably because memory ran out",
            hint="try again with fewer photos at once (-j 1)",
            file=job.source,
        )
    how = f"exit code {code}"
    if code < 0:
        with contextlib.suppress(ValueError):
            how = signal.Signals(-code).name
    return PhotoError(
        f"its process ended unexpectedly ({how})",
        hint="try the photo alone, or convert it to TIFF first",
        file=job.source,
    )


def _clear(job: Job | None) -> None:
    """Remove the unfinished outputs of a job."""
    if job is not None:
        for folder in {path.parent for path in job.outputs}:
            remove_stale_parts(folder)
