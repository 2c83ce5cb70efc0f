"""One photo of many: do its work, and return the outcome as data."""

from __future__ import annotations

import logging
import threading
import time
import traceback
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from deshake.batch.resume import doubt, made_by
from deshake.batch.verdict import UNSHAKEN
from deshake.errors import DeshakeError, OutputError, describe
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Iterator

    from deshake.batch.plan import Job
    from deshake.batch.work import Work
    from deshake.pictures.report_pictures import ReportPictures


__all__ = ["Result", "failure", "problem", "run_job"]

_OURS = logging.getLogger("deshake")


@dataclass(frozen=True)
class Result:
    """The result of the work on one photo.

    Parameters
    ----------
    job : Job
        The job.
    status : {"done", "skipped", "failed"}
        Skipped: its result was there already, or the figures say that it is not shaken.
    seconds : float
        Time that it took.
    figures : dict
        The figures of the work, as JSON data.
    warnings : tuple of str
        Warnings during the work.
    error, hint : str or None
        What is wrong, and what to try, if it failed.
    trace : str or None
        The traceback, if it failed.
    pictures : ReportPictures or None
        Pictures of the photo and its result, if a report wants them.

    """

    job: Job
    status: Literal["done", "skipped", "failed"]
    seconds: float = 0.0
    figures: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    error: str | None = None
    hint: str | None = None
    trace: str | None = None
    pictures: ReportPictures | None = None

    def report(self) -> dict[str, Any]:
        """Return the result as JSON data."""
        report: dict[str, Any] = {"status": self.status, "seconds": round(self.seconds, 2)}
        report |= self.job.files() | self.figures | {"warnings": list(self.warnings)}
        if self.status == "failed":
            report |= {"error": self.error, "hint": self.hint}
        return report


def run_job(job: Job, work: Work, run: Run = Run()) -> Result:
    """Do the work on one photo; the result reports any failure.

    Parameters
    ----------
    job : Job
        The photo.
    work : Work
        The work to do with it.
    run : Run, optional
        Threads to use, and who receives the progress.

    """
    start = time.perf_counter()
    with _warnings(job) as warnings:
        if job.problem is not None:
            return failure(job, job.problem)
        exists = job.keeps_result
        try:
            if exists and (job.skipped or not made_by(job, work)):
                _log_skipped(job, work)
                return Result(job, "skipped", time.perf_counter() - start, {}, tuple(warnings))
            figures = work(job, run)
        except Exception as error:  # noqa: BLE001  one bad photo never stops the rest
            if isinstance(error, OutputError) and job.keeps_result and not exists:
                # Another run made the result in the meantime.
                return Result(job, "skipped", time.perf_counter() - start, {}, tuple(warnings))
            return failure(job, error, time.perf_counter() - start, warnings)
    if figures.get("verdict") == UNSHAKEN:
        seconds = time.perf_counter() - start
        return Result(job, "skipped", seconds, figures, tuple(warnings))
    # Each note is a warning as well, unless the user wants only errors.
    notes = dict.fromkeys([*warnings, *figures.pop("notes", [])])
    pictures = figures.pop("pictures", None)
    seconds = time.perf_counter() - start
    return Result(job, "done", seconds, figures, tuple(notes), pictures=pictures)


def problem(job: Job, work: Work) -> DeshakeError | None:
    """Return why a job would fail before any work; None: it would not fail."""
    if job.problem is not None or job.skipped:
        return job.problem
    try:
        work.check(job)
    except DeshakeError as error:
        return error
    return None


def failure(
    job: Job, error: Exception, seconds: float = 0.0, warnings: list[str] | None = None
) -> Result:
    """Return the result of a photo that failed."""
    message, hint = describe(error)
    if str(job.source) not in message and not getattr(error, "file", None):
        message = f"{job.source}: {message}"
    expected = isinstance(error, DeshakeError) and error.__cause__ is None
    trace = None if expected else "".join(traceback.format_exception(error))
    notes = tuple(warnings or ())
    return Result(job, "failed", seconds, {}, notes, message, hint, trace)


def _log_skipped(job: Job, work: Work) -> None:
    """Log that the result exists already; warn if the work would make another one."""
    reason = doubt(job, work)
    if reason is None and job.missing:
        reason = f"{job.output} exists already, but does not say how it was made: "
        reason += f"its missing {' and '.join(job.missing)} cannot be made for it"
    if reason is None:
        _OURS.info("%s: skipped, %s exists already", job.source, job.output)
    else:
        _OURS.warning("%s: skipped, %s (--overwrite makes it again)", job.source, reason)


@contextmanager
def _warnings(job: Job) -> Iterator[list[str]]:
    """Collect the warnings of this thread, without the photo's name."""
    warnings: list[str] = []
    thread = threading.get_ident()

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.thread == thread:
                warnings.append(record.getMessage().removeprefix(f"{job.source}: "))

    collector = Collector(logging.WARNING)
    _OURS.addHandler(collector)
    try:
        yield warnings
    finally:
        _OURS.removeHandler(collector)
