"""``deshake calibrate``: find photos' focal lengths in pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from deshake.cli.batch import batch_options, photos_argument, planned, run_batch
from deshake.cli.general_options import general_options
from deshake.cli.json_output import print_json
from deshake.cli.option_groups import GroupedCommand
from deshake.cli.options import (
    focal_options,
    left_out,
    lens_options,
    one_to_stdout,
    output_option,
)
from deshake.cli.values import Grid

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.batch.task import Result
    from deshake.cli.batch import Batch
    from deshake.cli.context import Context

__all__ = ["command"]


@click.command("calibrate", cls=GroupedCommand)
@photos_argument
@output_option(
    "PHOTO's name with .camera.npz; none with --json",
    metavar="FILE.npz|DIR",
    note="; for several photos or a folder of them, a folder",
)
@click.option(
    "--chessboard",
    is_flag=True,
    help="The PHOTOs are of one printed chessboard: find the camera from them, its lens included.",
)
@click.option(
    "--board",
    type=Grid("COLUMNSxROWS", 3),
    help="Inner corners of the chessboard, where four squares meet.  [default: 9x6]",
)
@focal_options
@lens_options
@batch_options
@general_options
@click.pass_obj
def command(
    context: Context,
    /,
    *,
    photos: tuple[Path, ...],
    output: Path | None,
    chessboard: bool,
    board: tuple[int, int] | None,
    focal_px: float | None,
    focal_35mm: float | None,
    lens: bool | None,
    lens_model: str | None,
    batch: Batch,
) -> int:
    """Find photos' focal lengths in pixels.

    It comes from the options, from the EXIF tags of PHOTO (the 35 mm equivalent, or the focal
    length with the resolution of the focal plane), from the crop factor that lensfun knows, or from
    a table of cameras' sensors. A cropped or resized PHOTO, or one taken with a digital
    zoom, is noticed where its EXIF has a record of it. The camera file (.npz) has it with the
    principal point in the middle of the upright photo. The confidence that --json prints is a
    judgement of how likely the figure is right to within 5 %. If one photo fails, the others go on.

    With --chessboard, all PHOTOs are of one printed board, 3 at the least and better 10 to 20, the
    board tilted in all directions and seen in all parts of the frame, by one camera at one focal
    length. The camera file then has the focal length, the principal point and the distortion of the
    lens, for photos of this camera at this focal length.
    """
    if board is not None and not chessboard:
        raise click.UsageError("--board needs --chessboard.")
    if chessboard:
        given: dict[str, object] = {"focal-px": focal_px, "focal-35mm": focal_35mm, "lens": lens}
        given |= {"lens-model": lens_model, "retry-failed": batch.retry_failed}
        for name, value in given.items():
            if value is not None and not left_out(name.replace("-", "_"), "chessboard"):
                raise click.UsageError(f"--chessboard and --{name} cannot both be given.")
        _from_chessboards(context, photos, output, board or (9, 6), batch)
        return 0
    from deshake.batch.estimate_work import Calibrate
    from deshake.stages.camera_choice import CameraChoice
    from deshake.stages.estimating import camera_name

    to_stdout = one_to_stdout(as_json=batch.as_json, output=output)
    jobs = planned(photos, output, batch, name=camera_name, beside=not batch.as_json)
    silent = to_stdout or context.verbosity < 0
    work = Calibrate(CameraChoice(focal_px, focal_35mm, lens=lens, lens_model=lens_model))
    return run_batch(context, jobs, work, batch, None if silent else _line)


def _from_chessboards(
    context: Context,
    photos: tuple[Path, ...],
    output: Path | None,
    board: tuple[int, int],
    batch: Batch,
) -> None:
    """Find one camera from all photos."""
    from deshake.batch.folders import find_photos
    from deshake.lens.chessboard_photos import calibrate_from_chessboards

    if output is None and not batch.as_json:
        raise click.UsageError("name the camera file with -o.")
    to_stdout = one_to_stdout(as_json=batch.as_json, output=output)
    paths = [photo.path for photo in find_photos(photos, recursive=batch.recursive)]
    with context.bar("chessboard") as bar:
        result = calibrate_from_chessboards(
            paths, output, board, overwrite=batch.overwrite, run=context.run(bar)
        )
    fit = result.fit
    if batch.as_json:
        files = {"output": None if output is None else str(output)}
        print_json(result.report() | files)
    elif not to_stdout and context.verbosity >= 0:
        click.echo(f"{output}: {fit.camera.focal_px:.1f} pixels ({result.content.source})")


def _line(result: Result) -> str:
    """Return the figures in one line."""
    figures = result.figures
    return (
        f"{result.job.source}: {figures['focal_px']:.1f} pixels, "
        f"{figures['focal_35mm']:.1f} mm-equivalent ({figures['source']})"
    )
