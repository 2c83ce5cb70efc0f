"""A whole batch: in this process, in several processes, or on a cluster."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from deshake.batch.cluster import run_on_cluster
from deshake.batch.memory import Budget
from deshake.batch.processes import run_in_processes
from deshake.batch.task import run_job
from deshake.run import available_threads

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence

    from deshake.batch.plan import Job
    from deshake.batch.task import Result
    from deshake.batch.work import Work
    from deshake.run import Run

__all__ = ["Resources", "run_jobs"]


@dataclass(frozen=True)
class Resources:
    """What a run may take.

    Parameters
    ----------
    photos_at_once : int, optional
        By default as many as there are processors for their threads.
    memory : int, optional
        Bytes of memory for all of them; by default a share of what is available.
    scheduler : str, optional
        Address of a cluster's scheduler; then the cluster decides how many photos at once.

    """

    photos_at_once: int | None = None
    memory: int | None = None
    scheduler: str | None = None

    def shared(self, photos: int, threads: int | None) -> tuple[int, int]:
        """Return how many photos at once, and the threads for each, unless they are given."""
        processors = available_threads()
        at_once = self.photos_at_once or max(1, processors // (threads or 1))
        at_once = max(1, min(at_once, photos))
        return at_once, threads or max(1, processors // at_once)


def run_jobs(
    jobs: Sequence[Job],
    work: Work,
    resources: Resources,
    run: Run,
) -> Generator[Result, None, None]:
    """Do the work on photos; yield the result of each photo when it ends.

    A single photo runs in this process. Several photos run in separate processes or on a cluster:
    a crash on one photo does not affect the others.

    Parameters
    ----------
    jobs : sequence of Job
        The photos.
    work : Work
        The work to do with them.
    resources : Resources
        The resources that the run may use.
    run : Run
        Threads for each photo, by default an equal share of the processors; and who receives the
        progress of all photos together.

    """
    if len(jobs) == 1 and resources.memory is None and resources.scheduler is None:
        [job] = jobs
        yield run_job(job, work, replace(run, threads=resources.shared(1, run.threads)[1]))
        return
    overall = _Overall(jobs, run)
    for number, result in _elsewhere(jobs, work, resources, overall):
        overall.part(number, 1.0)
        yield result


def _elsewhere(
    jobs: Sequence[Job], work: Work, resources: Resources, overall: _Overall
) -> Iterator[tuple[int, Result]]:
    """Do the work in processes, or on a cluster."""
    if resources.scheduler is not None:
        threads = overall.run.threads or 1
        return run_on_cluster(jobs, work, resources.scheduler, threads=threads)
    processes, threads = resources.shared(len(jobs), overall.run.threads)
    return run_in_processes(
        jobs,
        work,
        processes=processes,
        threads=threads,
        budget=Budget.of(resources.memory),
        progress=overall.part,
    )


class _Overall:
    """The progress of all photos together. Photos without any work do not count."""

    def __init__(self, jobs: Sequence[Job], run: Run) -> None:
        self._shares = {
            number: 0.0
            for number, job in enumerate(jobs)
            if job.problem is None and not job.skipped
        }
        self._sum = 0.0
        self._done = 0
        self.run = run

    def part(self, number: int, share: float, text: str = "") -> None:  # noqa: ARG002
        """Report the progress of one photo."""
        if number not in self._shares:
            return
        self._sum += share - self._shares[number]
        self._done += share == 1.0 > self._shares[number]
        self._shares[number] = share
        count = len(self._shares)
        self.run.report(self._sum / count, f"{self._done} of {count} photos")
