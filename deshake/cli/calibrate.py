"""``deshake calibrate``: find photos' focal lengths in pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from deshake.cli.batch import batch_options, photos_argument, planned, run_batch
from deshake.cli.options import focal_options, general_options, one_to_stdout, output_option

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.batch.task import Result
    from deshake.cli.batch import Batch
    from deshake.cli.context import Context

__all__ = ["command"]


@click.command("calibrate")
@photos_argument
@output_option(
    "PHOTO's name with .camera.npz; none with --json",
    metavar="FILE.npz|DIR",
    note="; for several photos or a folder of them, a folder",
)
@focal_options
@batch_options
@general_options
@click.pass_obj
def command(
    context: Context,
    /,
    *,
    photos: tuple[Path, ...],
    output: Path | None,
    focal_px: float | None,
    focal_35mm: float | None,
    batch: Batch,
) -> int:
    """Find photos' focal lengths in pixels.

    It comes from the options, from the EXIF tags of PHOTO (the 35 mm equivalent, or the focal
    length with the resolution of the focal plane), from the crop factor that lensfun knows, or from
    a table of cameras' sensors. That PHOTO was cropped, resized or taken with a digital zoom is
    noticed where its EXIF tells. The camera file (.npz) has it with the principal point in the
    middle of the upright photo. The confidence that --json prints is a judgement of how likely the
    figure is right to within 5 %. If one photo fails, the others go on.
    """
    from deshake.batch.work import Calibrate
    from deshake.pipelines.file_stages import camera_name

    to_stdout = one_to_stdout(as_json=batch.as_json, output=output)
    jobs = planned(photos, output, batch, name=camera_name, beside=not batch.as_json)
    silent = to_stdout or context.verbosity < 0
    work = Calibrate(focal_px, focal_35mm)
    return run_batch(context, jobs, work, batch, None if silent else _line)


def _line(result: Result) -> str:
    """Say what was found in one line."""
    found = result.figures
    return (
        f"{result.job.source}: {found['focal_px']:.1f} pixels, "
        f"{found['focal_35mm']:.1f} mm-equivalent ({found['source']})"
    )
