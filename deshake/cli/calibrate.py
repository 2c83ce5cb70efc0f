"""``deshake calibrate``: find a photo's focal length in pixels."""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING

import click

from deshake.cli.options import (
    focal_options,
    general_options,
    json_option,
    one_to_stdout,
    output_option,
    overwrite_option,
    photo_argument,
)

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.cli.context import Context

__all__ = ["command"]

_log = logging.getLogger(__name__)


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
    length with the resolution of the focal plane), from the crop factor that lensfun knows, or from
    a table of cameras' sensors. That PHOTO was cropped, resized or taken with a digital zoom is
    noticed where its EXIF tells. The camera file (.npz) has it with the principal point in the
    middle of the upright photo. The confidence that --json prints is a judgement of how likely the
    figure is right to within 5 %.
    """
    from deshake.pipelines.calibration import calibrate_file

    if output is None and not as_json:
        output = photo.with_name(f"{photo.stem}.camera.npz")
    to_stdout = one_to_stdout(as_json=as_json, output=output)
    found = calibrate_file(
        photo, output, focal_px=focal_px, focal_35mm=focal_35mm, overwrite=overwrite
    )
    for line in found.considered:
        _log.info("%s: %s", photo, line)
    for note in found.notes:
        _log.warning("%s: %s", photo, note)
    if as_json:
        files = {"input": str(photo), "output": None if output is None else str(output)}
        click.echo(json.dumps(files | found.report()))
    elif not to_stdout and context.verbosity >= 0:
        click.echo(
            f"{photo}: {found.camera.focal_px:.1f} pixels, {found.focal_35mm:.1f} mm-equivalent "
            f"({found.source})"
        )
