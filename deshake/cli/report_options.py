"""The report of a run, and the file that is opened after it: options of ``fix`` and ``deblur``."""

from __future__ import annotations

import contextlib
import shlex
from dataclasses import dataclass, replace
from functools import wraps
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

import click
from click.core import ParameterSource

from deshake.cli.messages import print_exception, print_note
from deshake.cli.options import FILE, only_with

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from types import TracebackType

    from deshake.batch.plan import Job
    from deshake.batch.report import Report, ReportPlace
    from deshake.batch.task import Result
    from deshake.cli.context import Context
    from deshake.errors import DeshakeError

__all__ = ["ReportOptions", "Reporting", "report_options"]

F = TypeVar("F", bound="Callable[..., Any]")

_OF_THE_RUN = {
    *("output", "report", "report_images", "open_after", "overwrite", "skip_existing", "dry_run"),
    *("as_json", "fail_fast", "scheduler", "memory", "jobs", "recursive", "retry_failed"),
    "only_shaken",
    *("noisy", "kernel", "registration", "mask", "keep_kernels", "keep_masks"),  # named by each job
}
"""Options that a command for one photo does not repeat unchanged."""


def report_options(command: F) -> F:
    """Add --report, --report-images and --open, and hand them over as ``report``."""

    @wraps(command)
    def collected(
        *args: Any,  # noqa: ANN401
        report: Path | None,
        report_images: bool,
        open_after: bool,
        **values: Any,  # noqa: ANN401
    ) -> Any:  # noqa: ANN401
        return command(*args, report=ReportOptions(report, report_images, open_after), **values)

    for option in (
        click.option(
            "--open",
            "open_after",
            is_flag=True,
            callback=only_with("report", "compare"),
            help="Open the report, or the sheet of --compare, when it is written.",
        ),
        click.option(
            "--report-images",
            is_flag=True,
            callback=only_with("report"),
            help="Write the report's pictures into a folder beside it, larger than they are in "
            "the page.",
        ),
        click.option(
            "--report",
            type=FILE,
            metavar="FILE.html|DIR",
            help="Also write a page that shows each photo before and after, its kernel and what "
            "was done; in a folder it is called report.html.",
        ),
    ):
        collected = option(collected)
    return cast("F", collected)


@dataclass(frozen=True)
class ReportOptions:
    """The options of the report, and of the file that is opened at the end.

    Parameters
    ----------
    path : Path or None
        Where the report goes, if one is wanted.
    beside : bool
        Whether its pictures are files beside it.
    opens : bool
        Whether it is opened, or else the sheet that compares before and after.

    """

    path: Path | None = None
    beside: bool = False
    opens: bool = False

    def check(self, *, compare: bool) -> None:
        """Refuse options that contradict each other."""
        if self.path is None and self.beside:
            raise click.UsageError("--report-images needs --report.")
        if self.path is None and self.opens and not compare:
            raise click.UsageError("--open needs --report or --compare.")
        if str(self.path) == "-":
            raise click.UsageError("the report is not written to standard output: name a file")

    def room(self, photos: int) -> int | None:
        """Return the bytes that the pictures of one photo may take; None: no report is wanted."""
        if self.path is None:
            return None
        return self._place(self.path, overwrite=False).room(photos)

    def begun(
        self, context: Context, jobs: Sequence[Job], *, overwrite: bool, dry: bool
    ) -> Reporting:
        """Check where the report goes, and begin it.

        Raises
        ------
        click.UsageError
            If several sheets were to be opened.
        OutputError
            If the report cannot be written.

        """
        if self.opens and self.path is None and len(jobs) > 1:
            raise click.UsageError("--open opens one photo's sheet; for several, add --report")
        place = None if self.path is None else self._place(self.path, overwrite=overwrite)
        if place is not None:
            place.check(jobs, dry=dry)
        return Reporting(context, jobs, None if dry else place, opens=self.opens)

    def _place(self, path: Path, *, overwrite: bool) -> ReportPlace:
        from deshake.batch.report import ReportPlace

        return ReportPlace(path, self.beside, overwrite)


class Reporting:
    """Writes the report of a run, if there is one; if that fails, the photos continue.

    Parameters
    ----------
    context : Context
        The general options.
    jobs : sequence of Job
        All photos.
    place : ReportPlace or None
        Where the report goes, if one is wanted.
    opens : bool
        Whether it is opened at the end, or else the photo's sheet.

    """

    def __init__(
        self, context: Context, jobs: Sequence[Job], place: ReportPlace | None, *, opens: bool
    ) -> None:
        self.failed = False
        self._opens = opens
        self._sheet: Path | None = None
        self._report: Report | None = None
        self._resources = contextlib.ExitStack()
        if place is not None:
            from deshake.batch.report import Report

            command = shlex.join(["deshake", *context.arguments])
            self._report = Report(place, jobs, command, _commands(click.get_current_context()))

    def __enter__(self) -> Self:
        if self._report is not None:
            self._resources.enter_context(self._report)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._resources.__exit__(kind, error, trace)

    def add(self, result: Result) -> Result:
        """Add the result of a photo; return it without its pictures, to release their memory."""
        from deshake.errors import DeshakeError

        if result.status == "done":
            self._sheet = result.job.others.get("sheet")
        if self._report is not None:
            try:
                self._report.add(result)
            except DeshakeError as error:
                self._fail(error)
        return replace(result, pictures=None)

    def end(self) -> None:
        """Write the report, and open it, or the sheet, if the user wants."""
        from deshake.errors import DeshakeError

        shown = self._sheet
        if self._report is not None:
            try:
                shown = self._report.write()
            except DeshakeError as error:
                self._fail(error)
                return
            print_note(f"report: {shown}")
        if self._opens and shown is not None and not self.failed:
            _open(shown)

    def _fail(self, error: DeshakeError) -> None:
        """Warn that there will be no report, and why."""
        print_exception(error)
        self.failed = True
        self._report = None


def _open(path: Path) -> None:
    """Open a file with the program that the system has for it."""
    if click.launch(str(path.absolute())):
        print_note(f"{path} could not be opened; open it by hand")


def _commands(ctx: click.Context) -> Callable[[Job], str]:
    """Return a function from a job to the command for its photo alone."""
    options: dict[str, list[str]] = {}
    for param in ctx.command.params:
        name = param.name or ""
        value = ctx.params.get(name)
        default = ctx.get_parameter_source(name) is ParameterSource.DEFAULT
        of_the_photo = isinstance(param, click.Option) and name not in _OF_THE_RUN
        if of_the_photo and not default and value is not None and value is not False:
            options[name] = [param.opts[-1], *([] if value is True else [_as_typed(value)])]

    def command(job: Job) -> str:
        words = ["deshake", ctx.info_name or "", _argument(job.source)]
        if job.output is not None:
            words += ["-o", _doubled(_argument(job.output))]
        for name, path in job.needs.items():
            words += [f"--{name}", _argument(path)]
        if "kernel" in job.others:
            words += ["--keep-kernels", _argument(job.others["kernel"].parent)]
        if "moving_mask" in job.others:
            words += ["--keep-masks", _argument(job.others["moving_mask"].parent)]
        for name, typed in options.items():
            words += typed if _concerns(job, name, typed[-1]) else []
        return shlex.join(words)

    return command


def _concerns(job: Job, name: str, value: str) -> bool:
    """Return whether an option applies to the file of a job's result: some are for one format."""
    from deshake.formats.encoding import SUFFIXES

    form = None if job.output is None else SUFFIXES.get(job.output.suffix.lower())
    wanted = {"jpeg_quality": "JPEG", "format": SUFFIXES.get(f".{value}")}
    return wanted.get(name, form) == form


def _argument(path: Path) -> str:
    """Return a path in a form that cannot be read as an option."""
    name = str(path)
    return f"./{name}" if name.startswith("-") and name != "-" else name


def _doubled(name: str) -> str:
    """Return a name for -o, where a single brace would begin a field."""
    return name.replace("{", "{{").replace("}", "}}")


def _as_typed(value: Any) -> str:  # noqa: ANN401 - what options convert to
    """Return the value of an option as it is typed."""
    if isinstance(value, tuple):
        return ",".join(map(str, value))
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)
