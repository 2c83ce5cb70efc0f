"""``deshake fix``: remove camera shake from photos, in one go."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from deshake.cli.batch import (
    batch_options,
    for_masks,
    photos_argument,
    refuse_stdout,
    run_batch,
)
from deshake.cli.file_options import file_options, planned_results
from deshake.cli.finishing_options import finish_options, moving_masks
from deshake.cli.general_options import general_options
from deshake.cli.option_groups import GroupedCommand
from deshake.cli.options import (
    FILE,
    chosen_estimate,
    estimate_options,
    left_out,
    output_option,
    search_angle_option,
)
from deshake.cli.report_options import report_options
from deshake.cli.restoration_options import (
    check_pair,
    noisy_option,
    restoration,
    restoration_options,
)

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.batch.task import Result
    from deshake.cli.batch import Batch
    from deshake.cli.context import Context
    from deshake.cli.report_options import ReportOptions
    from deshake.stages.finishing import FinishingOptions

__all__ = ["command"]


@click.command("fix", cls=GroupedCommand)
@photos_argument
@output_option(
    "PHOTO's name with .deshaken before its ending",
    metavar="FILE|DIR|NAMES",
    note=". A slash ends the name of a new folder. For several photos or a folder of them, a "
    "folder, or a name with the fields {folder}, {parent}, {stem} and {ext}, as in "
    "'sharp/{folder}/{stem}_sharp.{ext}'",
)
@click.option(
    "--keep-kernels",
    type=FILE,
    metavar="DIR",
    help="Write each photo's kernel file into this folder.",
)
@click.option(
    "--only-shaken",
    is_flag=True,
    help="Pass over the photos that inspect calls sharp, soft or out of focus.",
)
@noisy_option
@search_angle_option
@estimate_options
@restoration_options
@finish_options
@file_options
@report_options
@batch_options
@general_options
@click.pass_obj
def command(
    context: Context,
    /,
    *,
    photos: tuple[Path, ...],
    output: Path | None,
    keep_kernels: Path | None,
    only_shaken: bool,
    camera: Path | None,
    noisy: Path | None,
    method: str | None,
    quality: str,
    iterations: int | None,
    mask: Path | None,
    keep_masks: Path | None,
    finish: FinishingOptions,
    report: ReportOptions,
    batch: Batch,
    **choices: Any,  # noqa: ANN401 - what `chosen_estimate` takes
) -> int:
    """Remove camera shake from photos, in one go.

    Calibrates each PHOTO, estimates its blur kernel and deblurs it: the same bytes as calibrate,
    estimate-blind and deblur give one by one. The photos of a folder are taken in natural order,
    with -r also those of the folders in it; hidden files and earlier results are passed over. If
    one photo fails, the others go on. --json prints a line a photo as it is done.

    With --noisy there is one PHOTO. A noisy photo helps to estimate its kernel and to deblur it:
    the same bytes as register, estimate-pair and deblur --noisy give one by one.
    """
    from deshake.batch.plan import Extra
    from deshake.batch.restoration_work import Fix
    from deshake.pictures.comparison import comparison_name
    from deshake.stages.estimating import kernel_name

    chosen = restoration(noisy, method=method, quality=quality, iterations=iterations)
    if noisy is not None:
        choices |= _for_pair(only_shaken=only_shaken, **choices)
        only_shaken = False
        check_pair(photos, noisy)
    elif choices["search_angle"] is not None:
        raise click.UsageError("--search-angle needs --noisy.")
    refuse_stdout(output)
    report.check(compare=finish.compare)
    extras = {} if keep_kernels is None else {"kernel": Extra(keep_kernels, kernel_name)}
    needs: dict[str, Any] = {} if noisy is None else {"noisy": lambda _: noisy}
    if mask is not None:
        needs["mask"] = for_masks(mask, photos)
    if finish.compare:
        extras["sheet"] = Extra(None, comparison_name)
    extras |= moving_masks(keep_masks)
    jobs = planned_results(photos, output, batch, finish, extras=extras, needs=needs)
    estimate, room = chosen_estimate(camera, **choices), report.room(len(jobs))
    work = Fix(estimate, chosen, finish, room, only_shaken)
    return run_batch(
        context,
        jobs,
        work,
        batch,
        note=_what_was_done,
        report=report,
        passed_over=work.passed_over if only_shaken else None,
    )


def _what_was_done(result: Result) -> str:
    """Return the line that reports what was written for a photo, and what was done to it."""
    from deshake.batch.verdict import summary_words

    to = "" if result.status == "skipped" else f" -> {result.job.output}"
    return f"{result.job.source}{to}: {summary_words(result.figures)}"


def _for_pair(*, region: object, focal: object, only_shaken: bool, **_: object) -> dict[str, Any]:
    """Refuse options that only a blind estimate uses; return the defaults that replace them."""
    ctx = click.get_current_context()
    chosen = {"region": region is not None, "focal": focal, "only_shaken": only_shaken}
    chosen["estimator"] = ctx.get_parameter_source("estimator") is not ParameterSource.DEFAULT
    for name in [name for name, given in chosen.items() if given]:
        if not left_out(name, "noisy"):
            option = name.replace("_", "-")
            raise click.UsageError(
                f"--{option} does not go with --noisy: it is for photos without a noisy one."
            )
    return {"region": None, "estimator": "edges", "focal": None}
