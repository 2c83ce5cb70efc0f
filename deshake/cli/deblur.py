"""``deshake deblur``: deblur photos whose blur kernels are known."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from deshake.cli.batch import (
    batch_options,
    for_masks,
    refuse_stdout,
    run_batch,
)
from deshake.cli.file_options import file_options, planned_results
from deshake.cli.finishing_options import finish_options, moving_masks
from deshake.cli.general_options import general_options
from deshake.cli.option_groups import GroupedCommand
from deshake.cli.options import (
    FILE,
    left_out,
    output_option,
    search_angle_option,
    transfer_option,
)
from deshake.cli.report_options import report_options
from deshake.cli.restoration_options import (
    check_pair,
    noisy_option,
    restoration,
    restoration_options,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.batch.folders import InputPhoto
    from deshake.cli.batch import Batch
    from deshake.cli.context import Context
    from deshake.cli.report_options import ReportOptions
    from deshake.formats.transfer import TransferName
    from deshake.stages.finishing import FinishingOptions

__all__ = ["command"]


@click.command("deblur", cls=GroupedCommand)
@click.argument("photos", type=FILE, nargs=-1, required=True, metavar="PHOTO KERNEL | PHOTO|DIR...")
@output_option(
    "PHOTO's name with .deshaken before its ending",
    metavar="FILE|DIR|NAMES",
    note=". A slash ends the name of a new folder. For several photos or a folder of them, a "
    "folder, or a name with the fields {folder}, {parent}, {stem} and {ext}, as in "
    "'sharp/{folder}/{stem}_sharp.{ext}'",
)
@click.option(
    "--kernel",
    type=FILE,
    metavar="FILE|DIR",
    help="The kernel, or a folder that has <stem>.kernel.npz for each photo. Needed for several "
    "photos or a folder of them.",
)
@noisy_option
@click.option(
    "--registration",
    type=FILE,
    metavar="FILE.npz",
    help="Registration file written by register, for --noisy.  [default: register the photos]",
)
@search_angle_option
@restoration_options
@finish_options
@file_options
@report_options
@transfer_option
@batch_options
@general_options
@click.pass_obj
def command(
    context: Context,
    /,
    *,
    photos: tuple[Path, ...],
    output: Path | None,
    kernel: Path | None,
    noisy: Path | None,
    registration: Path | None,
    search_angle: float | None,
    transfer: TransferName | None,
    mask: Path | None,
    keep_masks: Path | None,
    finish: FinishingOptions,
    report: ReportOptions,
    batch: Batch,
    **choices: Any,  # noqa: ANN401 - how to deblur
) -> int:
    """Deblur photos whose blur kernels are known.

    KERNEL is a kernel file (.npz), or - for standard input. It may have been made from PHOTO at
    another size. With --noisy it is that of estimate-pair: by default the photos are registered
    as they were there. The result has the format, depth and metadata of PHOTO,
    and the metadata record how it was made. Where the kernel's camera has a lens that bends,
    the result is straight, unless its geometry is kept.

    With --kernel all arguments are photos, or folders of them: those of a folder are taken in
    natural order, with -r also those of the folders in it. If one fails, the others go on.
    """
    from deshake.batch.plan import Extra
    from deshake.batch.restoration_work import Deblur
    from deshake.pictures.comparison import comparison_name

    if noisy is None and registration is not None:
        raise click.UsageError("--registration needs --noisy.")
    if registration is not None and left_out("search_angle", "registration"):
        search_angle = None
    if search_angle is not None and (noisy is None or registration is not None):
        raise click.UsageError(
            "--search-angle needs --noisy."
            if noisy is None
            else "--registration and --search-angle cannot both be given."
        )
    if kernel is None:
        if len(photos) != 2 or photos[0].is_dir():
            raise click.UsageError(
                "name one photo and its kernel file, or the kernels with --kernel"
            )
        *photos_only, kernel = photos
        photos = tuple(photos_only)
    if "-" in map(str, photos):
        raise click.UsageError("photos are not read from standard input: name a file.")
    chosen = restoration(noisy, **choices)
    refuse_stdout(output)
    report.check(compare=finish.compare)
    needs: dict[str, Callable[[InputPhoto], Path | None]] = {"kernel": _kernels(kernel)}
    if noisy is not None:
        check_pair(photos, noisy)
        needs |= {"noisy": lambda _: noisy, "registration": lambda _: registration}
    if mask is not None:
        needs["mask"] = for_masks(mask, photos)
    extras = {"sheet": Extra(None, comparison_name)} if finish.compare else {}
    extras |= moving_masks(keep_masks)
    jobs = planned_results(photos, output, batch, finish, extras=extras, needs=needs)
    work = Deblur(chosen, transfer, finish, search_angle, report.room(len(jobs)))
    return run_batch(context, jobs, work, batch, report=report)


def _kernels(path: Path) -> Callable[[InputPhoto], Path]:
    """Return a function from a photo to its kernel file: `path`, or one in that folder."""
    from deshake.stages.estimating import kernel_name

    if not path.is_dir():
        return lambda _: path
    return lambda photo: path / photo.below / kernel_name(photo.path)
