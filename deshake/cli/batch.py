"""The batch frame: its options, and how a run of photos goes and is reported."""

from __future__ import annotations

import logging
import time
from collections import Counter
from contextlib import ExitStack, closing
from dataclasses import dataclass, fields
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from deshake.cli.json_output import print_json
from deshake.cli.messages import print_error, print_note
from deshake.cli.options import (
    FILE,
    json_option,
    names_folder,
    no_stdin,
    only_one_of,
    overwrite_option,
)
from deshake.cli.retry import retried, retry_option
from deshake.cli.values import Count, Size

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from deshake.batch.folders import InputPhoto
    from deshake.batch.plan import Existing, Job
    from deshake.batch.task import Result
    from deshake.batch.work import Work
    from deshake.cli.context import Context
    from deshake.cli.report_options import ReportOptions

__all__ = [
    "Batch",
    "batch_options",
    "for_masks",
    "frame_options",
    "photos_argument",
    "planned",
    "reading_options",
    "refuse_stdout",
    "run_batch",
]

F = TypeVar("F", bound="Callable[..., Any]")

_log = logging.getLogger(__name__)

_NAMED = 10
"""Failed photos that the summary names."""

photos_argument = click.argument(
    "photos", type=FILE, nargs=-1, required=True, metavar="PHOTO|DIR...", callback=no_stdin
)


_DRY_RUN = click.option(
    "--dry-run",
    is_flag=True,
    help="Check the names and say what would be done for each photo; do nothing.",
)
_FAIL_FAST = click.option("--fail-fast", is_flag=True, help="Stop at the first photo that fails.")
_SKIP_EXISTING = click.option(
    "--skip-existing",
    is_flag=True,
    callback=only_one_of("overwrite"),
    help="Leave out the photos whose outputs exist already. What is missing beside a result (its "
    "sheet, its kernel) is made again, and the result stays.",
)
_FRAME_OPTIONS = (_DRY_RUN, _SKIP_EXISTING, overwrite_option, json_option)
_READING_OPTIONS = (
    _DRY_RUN,
    _FAIL_FAST,
    json_option,
    click.option(
        "--scheduler",
        metavar="ADDRESS",
        callback=only_one_of("jobs", "memory"),
        help="Hand the photos to the dask.distributed cluster of this scheduler, as in "
        "tcp://host:8786, whose machines share the folders. --threads is then 1 by default.",
    ),
    click.option(
        "--memory",
        type=Size(),
        callback=only_one_of("scheduler"),
        help="Memory for all photos at once, as in 4G.  [default: 70 % of what is available]",
    ),
    click.option(
        "-j",
        "--jobs",
        type=Count(1, 1024),
        callback=only_one_of("scheduler"),
        help="Photos at once, memory permitting.  [default: processors / threads]",
    ),
    click.option(
        "-r",
        "--recursive",
        is_flag=True,
        help="Also take the photos of folders in folders; links to folders are followed.",
    ),
)
_BATCH_OPTIONS = (
    *_READING_OPTIONS[:2],
    retry_option,
    _SKIP_EXISTING,
    overwrite_option,
    *_READING_OPTIONS[2:],
)


@dataclass(frozen=True)
class Batch:
    """The options of the batch frame; those for one photo or pair have the first four."""

    as_json: bool
    dry_run: bool
    overwrite: bool = False
    skip_existing: bool = False
    recursive: bool = False
    jobs: int | None = None
    memory: int | None = None
    scheduler: str | None = None
    fail_fast: bool = False
    retry_failed: Path | None = None

    @property
    def existing(self) -> Existing:
        """What is done about results that exist already."""
        return "replace" if self.overwrite else "skip" if self.skip_existing else "refuse"


def frame_options(command: F) -> F:
    """Add the options of `Batch` that one photo has, and hand them over as ``batch``."""
    return _collected(command, _FRAME_OPTIONS)


def reading_options(command: F) -> F:
    """Add the options of `Batch` that a command without results has, as ``batch``."""
    return _collected(command, _READING_OPTIONS)


def batch_options(command: F) -> F:
    """Add the options of `Batch`, and hand them over as one argument named ``batch``."""
    return _collected(command, _BATCH_OPTIONS)


def _collected(command: F, options: Sequence[Callable[[Any], Any]]) -> F:
    """Add options. Each is a field of `Batch`."""

    @wraps(command)
    def collected(*args: Any, **values: Any) -> Any:  # noqa: ANN401
        names = [each.name for each in fields(Batch) if each.name in values]
        given = {name: values.pop(name) for name in names}
        return command(*args, batch=Batch(**given), **values)

    for option in options:
        collected = option(collected)
    return cast("F", collected)


def for_masks(mask: Path, photos: Sequence[Path]) -> Callable[[InputPhoto], Path | None]:
    """Return a function from a photo to its mask: `mask`, or one in that folder."""
    if not mask.is_dir():
        if len(photos) > 1 or photos[0].is_dir():
            raise click.UsageError("for several photos, --mask names a folder of masks")
        return lambda _: mask
    from deshake.stages.blending import find_mask

    return lambda photo: find_mask(mask / photo.below, photo.path)


def refuse_stdout(output: Path | None) -> None:
    """Refuse ``-o -`` for photos."""
    if str(output) == "-":
        raise click.UsageError("photos are not written to standard output: name a file with -o")


def planned(
    photos: Sequence[Path],
    output: Path | None,
    batch: Batch,
    **more: Any,  # noqa: ANN401 - what `plan` takes
) -> list[Job]:
    """Plan the jobs, or those that failed before; contradictions are wrong usage."""
    from deshake.batch.plan import PlanError, plan

    try:
        jobs = plan(
            photos,
            output,
            into=names_folder(output),
            recursive=batch.recursive,
            existing=batch.existing,
            dry=batch.dry_run,
            **more,
        )
    except PlanError as error:
        hint = f" ({error.hint})" if error.hint else ""
        raise click.UsageError(f"{error}{hint}") from None
    return jobs if batch.retry_failed is None else retried(jobs, batch.retry_failed)


def run_batch(
    context: Context,
    jobs: Sequence[Job],
    work: Work,
    batch: Batch,
    line: Callable[[Result], str] | None = None,
    *,
    note: Callable[[Result], str] | None = None,
    report: ReportOptions | None = None,
    passed_over: Callable[[Job], dict[str, Any] | None] | None = None,
) -> int:
    """Do the work on all photos, report each result, and return the exit code.

    Parameters
    ----------
    context : Context
        The general options.
    jobs : sequence of Job
        The photos.
    work : Work
        The work to do with them.
    batch : Batch
        Options of the batch frame.
    line : callable, optional
        Returns the line on standard output for a photo that is done, without ``--json``.
    note : callable, optional
        Returns the line on standard error for a photo that is done.
    report : ReportOptions, optional
        Options of the report.
    passed_over : callable, optional
        Returns the verdict on a photo that the work passes over, for a dry run.

    """
    from deshake.batch.jobs import Resources, run_jobs
    from deshake.cli.report_options import ReportOptions

    reporting = (report or ReportOptions()).begun(
        context, jobs, overwrite=batch.existing != "refuse", dry=batch.dry_run
    )
    if batch.dry_run:
        return _print_plan(jobs, work, batch, passed_over)
    start = time.monotonic()
    if batch.scheduler is not None:
        _check_files(jobs)
    resources = Resources(batch.jobs, batch.memory, batch.scheduler)
    results: list[Result] = []
    title = jobs[0].source.name if len(jobs) == 1 else f"0 of {len(jobs)} photos"

    def progress(share: float, text: str) -> None:
        bar(share, f"{title}: {text}" if len(jobs) == 1 else text)

    with reporting, ExitStack() as stack:
        bar = stack.enter_context(context.bar(title))
        running = stack.enter_context(
            closing(run_jobs(jobs, work, resources, context.run(progress)))
        )
        for done in running:
            result = reporting.add(done)
            results.append(result)
            _print_result(result, batch, line, note)
            if result.status == "failed" and batch.fail_fast:
                break
        stack.close()  # ends the bar and all processes
        reporting.end()
    if len(jobs) > 1:
        _print_summary(results, len(jobs), time.monotonic() - start)
    return 1 if reporting.failed or any(result.status == "failed" for result in results) else 0


def _check_files(jobs: Sequence[Job]) -> None:
    """Refuse standard input and output, which other machines do not have."""
    for job in jobs:
        if "-" in map(str, (job.source, *job.needs.values(), *job.outputs)):
            raise click.UsageError("--scheduler does not go with standard input or output.")


def _print_plan(
    jobs: Sequence[Job],
    work: Work,
    batch: Batch,
    passed_over: Callable[[Job], dict[str, Any] | None] | None,
) -> int:
    """Print the plan for each photo, or why there is none."""
    from deshake.batch.task import failure, problem
    from deshake.errors import DeshakeError

    code = 0
    for job in jobs:
        refusal, verdict = problem(job, work), None
        if passed_over is not None and refusal is None and not job.skipped:
            try:
                verdict = passed_over(job)
            except DeshakeError as error:
                refusal = error
        status = "skip" if job.skipped or verdict else "do"
        failed = None if refusal is None else failure(job, refusal)
        code = code if failed is None else 1
        if batch.as_json:
            report = {"status": status} | job.files() | (verdict or {})
            print_json(report if failed is None else failed.report())
        elif verdict:
            click.echo(f"{status} {job.source}: {verdict['reason']}")
        elif failed is None:
            to = "" if job.output is None else f" -> {job.output}"
            click.echo(f"{status} {job.source}{to}")
        if failed is not None:
            print_error(failed.error or "", hint=failed.hint)
    return code


def _print_result(
    result: Result,
    batch: Batch,
    line: Callable[[Result], str] | None,
    note: Callable[[Result], str] | None,
) -> None:
    """Print the result of a photo, as `run_batch` describes it."""
    if batch.as_json:
        print_json(result.report())
    elif line is not None and result.status == "done":
        click.echo(line(result))
    worked_on = result.status == "done" or "verdict" in result.figures
    if note is not None and worked_on:
        print_note(note(result))
    if result.status == "failed":
        _print_failure(result)


def _print_failure(result: Result) -> None:
    """Print the failure of a photo."""
    print_error(result.error or "", hint=result.hint)
    if result.trace:
        _log.debug("traceback\n%s", result.trace.rstrip())


def _print_summary(results: Sequence[Result], photos: int, seconds: float) -> None:
    """Print the number of photos for each outcome, and the names of the failed ones."""
    from deshake.batch.verdict import UNSHAKEN

    count = Counter(result.status for result in results)
    left = sum(result.figures.get("verdict") == "left" for result in results)
    parts = [f"{count['done'] - left} done"]
    if left:
        parts.append(f"{left} left as {'it is' if left == 1 else 'they are'}")
    unshaken = sum(result.figures.get("verdict") == UNSHAKEN for result in results)
    if unshaken:
        parts.append(f"{unshaken} not shaken")
    parts += [f"{count['skipped'] - unshaken} skipped", f"{count['failed']} failed"]
    if photos > len(results):
        parts.append(f"{photos - len(results)} not begun")
    warned = sum(bool(result.warnings) for result in results)
    notes = f"; {warned} with warnings" if warned else ""
    minutes, rest = divmod(round(seconds), 60)
    took = f"{minutes // 60}:{minutes % 60:02}:{rest:02}"
    print_note(f"{photos} photos: {', '.join(parts)}{notes}; {took}")
    failed = [str(result.job.source) for result in results if result.status == "failed"]
    for name in failed[:_NAMED]:
        print_note(f"  failed: {name}")
    if len(failed) > _NAMED:
        print_note(f"  and {len(failed) - _NAMED} more")
