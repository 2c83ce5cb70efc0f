"""The names and files of results: options of ``fix`` and ``deblur``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from click.core import ParameterSource

from deshake.cli.batch import planned
from deshake.cli.options import names_folder
from deshake.cli.values import Count, PhotoFormat

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from deshake.batch.name_template import NameTemplate
    from deshake.batch.plan import Job
    from deshake.cli.batch import Batch
    from deshake.formats.encoding import Format
    from deshake.stages.finishing import FinishingOptions
    from deshake.stages.result_file import ResultFile

__all__ = [
    "NO_JPEG",
    "check_ending",
    "chosen_format",
    "file_options",
    "format_option",
    "is_typed",
    "planned_results",
    "quality_option",
]

F = TypeVar("F", bound="Callable[..., Any]")

NO_JPEG = "--jpeg-quality is for JPEGs, and no result is one: add --format jpeg."
"""The error of --jpeg-quality if no result is a JPEG."""

format_option = click.option(
    "--format",
    type=PhotoFormat(),
    help="Format of the result, whose name ends accordingly.  [default: the photo's own, or that "
    "of the ending of -o]",
)
quality_option = click.option(
    "--jpeg-quality",
    type=Count(1, 100),
    help="Quality of results that are JPEGs; it changes nothing in other formats.  [default: the "
    "photo's own tables if it is a JPEG, else 95]",
)


def file_options(command: F) -> F:
    """Add the options of `ResultFile`, and put them into the ``finish`` of `finish_options`."""

    @wraps(command)
    def collected(*args: Any, finish: FinishingOptions, **values: Any) -> Any:  # noqa: ANN401
        from deshake.stages.result_file import ResultFile

        file = ResultFile(
            form=chosen_format(values.pop("format"), values["output"]),
            jpeg_quality=values.pop("jpeg_quality"),
            max_size=values.pop("max_size"),
            keeps_time=values.pop("preserve"),
        )
        return command(*args, finish=replace(finish, file=file), **values)

    for option in (
        click.option(
            "--preserve",
            is_flag=True,
            help="Give the result the modification time of the photo. It has the photo's "
            "permissions always.",
        ),
        click.option(
            "--max-size",
            type=Count(1, 1_000_000, "PIXELS"),
            help="Reduce the result, when it is written, to so many pixels on its longer side, as "
            "in 2048 for mail; smaller ones stay.  [default: the photo's size]",
        ),
        quality_option,
        format_option,
    ):
        collected = option(collected)
    return cast("F", collected)


def chosen_format(name: str | None, output: Path | None) -> Format | None:
    """Return the format that --format names.

    If the configuration file or the environment has it, an output's ending has priority.
    """
    from deshake.formats.encoding import SUFFIXES

    if name is None:
        return None
    stated = None if output is None or names_folder(output) else SUFFIXES.get(output.suffix.lower())
    return SUFFIXES[f".{name}"] if stated is None or is_typed("format") else None


def is_typed(name: str) -> bool:
    """Return whether an option stands on the command line."""
    source = click.get_current_context().get_parameter_source(name)
    return source is ParameterSource.COMMANDLINE


def planned_results(
    photos: Sequence[Path],
    output: Path | None,
    batch: Batch,
    finish: FinishingOptions,
    **more: Any,  # noqa: ANN401 - what `plan` takes
) -> list[Job]:
    """Plan the jobs, with results named and written as the options say.

    Raises
    ------
    click.UsageError
        If the options contradict each other.

    """
    from deshake.formats.output_names import output_name

    form = finish.file.form
    template: NameTemplate | None = None
    if output is not None and {"{", "}"} & set(str(output)):
        template, output = _named(output, finish.file)
    if output is not None and len(photos) == 1 and not (photos[0].is_dir() or names_folder(output)):
        check_ending(output, finish.file)
    return planned(
        photos,
        output,
        batch,
        template=template,
        name=partial(output_name, form=form),
        check=partial(_check_quality, finish=finish),
        **more,
    )


def check_ending(output: Path, file: ResultFile) -> None:
    """Refuse a name whose ending stands for another format than --format."""
    from deshake.formats.encoding import SUFFIXES

    if file.form is not None and SUFFIXES.get(output.suffix.lower()) != file.form:
        raise click.UsageError(
            f"--format does not go with -o {output}: the ending of this name is not that of a "
            f"{file.form}."
        )


def _named(output: Path, file: ResultFile) -> tuple[NameTemplate | None, Path | None]:
    """Return the template in -o, or the path in -o if its braces belong to a name."""
    from deshake.batch.name_template import NameTemplate

    try:
        template = NameTemplate(str(output), file.form)
    except ValueError as error:
        raise click.UsageError(f"-o {output}: {error}") from None
    return (template, None) if template.has_fields else (None, template.name)


def _check_quality(jobs: Sequence[Job], finish: FinishingOptions) -> None:
    """Refuse --jpeg-quality if no result is a JPEG."""
    from deshake.batch.plan import PlanError

    if finish.file.jpeg_quality is None or not is_typed("jpeg_quality"):
        return
    outputs = [job.output for job in jobs if job.output is not None]
    if outputs and not any(map(finish.file.is_jpeg, outputs)):
        raise PlanError(NO_JPEG)
