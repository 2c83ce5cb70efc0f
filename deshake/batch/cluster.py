"""Many photos on many machines: the same work per photo, handed to a dask.distributed cluster.

The machines share the folders of the photos and of the results, under the same names.
"""

from __future__ import annotations

import logging
import os
import secrets
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

from deshake.batch.task import Result, failure, run_job
from deshake.batch.worker import bind_opencv
from deshake.errors import DeshakeError, PhotoError
from deshake.run import Run
from deshake.version import __version__

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Mapping, Sequence
    from pathlib import Path

    from deshake.batch.plan import Job
    from deshake.batch.work import Work

__all__ = ["ClusterError", "run_on_cluster"]

_log = logging.getLogger(__name__)

_TIMEOUT = 15.0
"""Seconds to wait for the scheduler, and for its first worker."""
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


class ClusterError(DeshakeError):
    """The cluster cannot do the work."""


def run_on_cluster(
    jobs: Sequence[Job], work: Work, address: str, *, threads: int = 1
) -> Generator[tuple[int, Result], None, None]:
    """Do the work on many photos on a cluster; yield the result of each photo when it ends.

    If a worker dies, another one gets its photo. Closing the iterator takes back the photos that no
    worker has begun; workers finish the others.

    Parameters
    ----------
    jobs : sequence of Job
        The photos.
    work : Work
        The work to do with them.
    address : str
        Address of the scheduler, as in ``tcp://host:8786``.
    threads : int
        Threads for each photo.

    Raises
    ------
    ClusterError
        If there is no scheduler or no worker, a worker has no deshake or another version, or does
        not see the photos and the folders of the results.

    """
    with _connected(address) as client:
        _check_versions(client)
        _check_folders(client, jobs)
        futures = client.map(
            _task, [_anywhere(job) for job in jobs], work=work, threads=threads, pure=False
        )
        numbers = {future.key: number for number, future in enumerate(futures)}
        waiting = _distributed().as_completed(futures)
        del futures  # each is released when it is done
        try:
            for future in waiting:
                number = numbers.pop(future.key)
                yield number, _result(jobs[number], future)
        finally:
            client.cancel([future for future in waiting.futures if future.key in numbers])


def _task(job: Job, work: Work, threads: int) -> Result:
    """Do the work on one photo, on a worker."""
    bind_opencv(threads)
    return run_job(job, work, Run(threads))


def _anywhere(job: Job) -> Job:
    """Return a job that any machine can do, even again after a worker has died.

    This machine has checked that the result may be written, so what a dead worker left is replaced.
    """

    def absolute(files: Mapping[str, Path]) -> dict[str, Path]:
        return {kind: path.absolute() for kind, path in files.items()}

    return replace(
        job,
        source=job.source.absolute(),
        output=None if job.output is None else job.output.absolute(),
        others=absolute(job.others),
        needs=absolute(job.needs),
        existing="skip" if job.keeps_result else "replace",
    )


def _result(job: Job, future: Any) -> Result:  # noqa: ANN401 - of an untyped package
    """Return the result of a job, and log its warnings here."""
    if future.status == "finished":
        result = replace(cast("Result", future.result()), job=job)
        for warning in result.warnings:
            _log.warning("%s: %s", job.source, warning)
        return result
    error = future.exception() if future.status == "error" else None
    if type(error).__name__ == "KilledWorker":
        what = "every worker that took it died, probably because memory ran out"
        return failure(job, PhotoError(what, hint="give the workers more memory", file=job.source))
    what = f"the cluster lost it ({error or future.status})"
    return failure(job, PhotoError(what, hint="run again with --skip-existing", file=job.source))


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    """Connect to the scheduler, and wait for its first worker."""
    package = _distributed()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = package.Client(address, timeout=_TIMEOUT)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"{address}: no scheduler answers",
            hint="start one with: dask scheduler, and give its address, as in tcp://host:8786",
        ) from error
    try:
        try:
            client.wait_for_workers(1, timeout=_TIMEOUT)
        except TimeoutError as error:
            raise ClusterError(
                f"{address}: the scheduler has no workers",
                hint=f"start some with: dask worker {address} --nthreads 1",
            ) from error
        yield client
    finally:
        with suppress(OSError, TimeoutError):
            client.close()


def _distributed() -> Any:  # noqa: ANN401 - an untyped package
    """Return dask.distributed, which is optional."""
    try:
        return import_module("distributed")
    except ImportError as error:
        raise ClusterError(
            "--scheduler needs dask.distributed", hint="pip install 'deshake[cluster]'"
        ) from error


def _check_versions(client: Any) -> None:  # noqa: ANN401 - of an untyped package
    """Refuse workers of another version; warn of those whose sums depend on their threads."""
    names = _ONE_THREAD

    def versions() -> tuple[str | None, bool]:  # the workers get its code
        import os  # noqa: PLC0415

        single = any(os.environ.get(name) == "1" for name in names)
        try:
            import deshake  # noqa: PLC0415
        except ImportError:
            return None, single
        return deshake.__version__, single

    for worker, (version, single) in client.run(versions).items():
        if version != __version__:
            has = "has no deshake" if version is None else f"has deshake {version}"
            raise ClusterError(
                f"{worker}: the worker {has}, and this is {__version__}",
                hint="install the same version on all machines",
            )
        if not single:
            _log.warning(
                "%s: results can differ in the last digit: start the worker with OMP_NUM_THREADS=1",
                worker,
            )


def _check_folders(client: Any, jobs: Sequence[Job]) -> None:  # noqa: ANN401 - of an untyped package
    """Refuse workers that do not see the first photo, or cannot write beside its result.

    The check writes a file there that they must read.
    """
    job = next((_anywhere(job) for job in jobs if job.problem is None), None)
    if job is None:
        return
    size = job.source.stat().st_size if job.source.exists() else None
    for folder in {path.parent for path in job.outputs}:
        token = folder / f".deshake-{secrets.token_hex(8)}.token"
        token.write_text(token.name, "ascii")
        try:
            answers = client.run(_not_shared, job.source, size, token)
        finally:
            token.unlink(missing_ok=True)
        for worker, missing in answers.items():
            if missing:
                raise ClusterError(
                    f"{worker}: the worker does not see {missing} as it is here",
                    hint="all machines need the same folders under the same names",
                )


def _not_shared(source: Path, size: int | None, token: Path) -> str | None:
    """Return what this machine does not share with the caller's machine; None: it shares all."""
    if (source.stat().st_size if source.exists() else None) != size:
        return str(source)
    try:
        content = token.read_text("ascii")
    except OSError:
        return str(token.parent)
    return None if content == token.name and os.access(token.parent, os.W_OK) else str(token.parent)
