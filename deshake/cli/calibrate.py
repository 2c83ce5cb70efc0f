"""``deshake calibrate``: find a photo's focal length in pixels."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import click

from deshake.cli.options import (
    focal_options,
    general_options,
    json_option,
    output_option,
    overwrite_option,
    photo_argument,
)

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.cli.context import Context

__all__ = ["command"]


@click.command("calibrate")
@photo_argument
@output_option("PHOTO's name with .camera.npz; none with --json", metavar="FILE.npz")
@focal_options
@json_option
@overwrite_option
@general_options
@click.pass_obj
def command(
    context: Context,
    /,
    *,
    photo: Path,
    output: Path | None,
    focal_px: float | None,
    focal_35mm: float | None,
    as_json: bool,
    overwrite: bool,
) -> None:
    """Find a photo's focal length in pixels.

    It comes from the options, from the EXIF tags of PHOTO (the 35 mm equivalent, or the focal
    length with the resolution of the focal plane), or from a table of cameras' sensors. The
    camera file (.npz) has it with the principal point in the middle of the upright photo.
    """
    from deshake.io.sensors import FULL_FRAME_DIAGONAL
    from deshake.pipelines.file_stages import calibrate_file

    if output is None and not as_json:
        output = photo.with_name(f"{photo.stem}.camera.npz")
    to_stdout = str(output) == "-"
    if as_json and to_stdout:
        raise click.UsageError("--json and -o - cannot both go to standard output.")
    found = calibrate_file(
        photo, output, focal_px=focal_px, focal_35mm=focal_35mm, overwrite=overwrite
    )
    camera = found.camera
    film = camera.focal_px * FULL_FRAME_DIAGONAL / math.hypot(*camera.shape)
    if as_json:
        result = {
            "input": str(photo),
            "output": None if output is None else str(output),
            "focal_px": round(camera.focal_px, 3),
            "focal_35mm": round(film, 3),
            "source": found.source,
            "width": camera.width,
            "height": camera.height,
        }
        click.echo(json.dumps(result))
    elif not to_stdout and context.verbosity >= 0:
        click.echo(
            f"{photo}: {camera.focal_px:.1f} pixels, {film:.1f} mm-equivalent ({found.source})"
        )
