"""``deshake register``: find how a noisy photo lies to a blurred one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from deshake.cli.json_output import print_json
from deshake.cli.options import (
    FILE,
    camera_option,
    focal_options,
    general_options,
    json_option,
    lens_options,
    no_stdin,
    one_to_stdout,
    output_option,
    overwrite_option,
    transfer_option,
)
from deshake.cli.values import Number

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.cli.context import Context

__all__ = ["command"]


@click.command("register")
@click.argument("blurred", type=FILE, callback=no_stdin)
@click.argument("noisy", type=FILE, callback=no_stdin)
@output_option("BLURRED's name with .registration.npz", metavar="FILE.npz")
@click.option(
    "--preview",
    type=FILE,
    metavar="FILE.png",
    help="Also write both photos as the squares of a checkerboard, where edges run on from square "
    "to square if the registration is right.  [default: nowhere]",
)
@click.option(
    "--max-angle",
    type=Number("DEGREES", most=45),
    help="Largest rotation about any axis to look for.  [default: 10]",
)
@camera_option
@focal_options
@lens_options
@transfer_option
@json_option
@overwrite_option
@general_options
@click.pass_obj
def command(
    context: Context,
    /,
    *,
    blurred: Path,
    noisy: Path,
    output: Path | None,
    preview: Path | None,
    camera: Path | None,
    as_json: bool,
    overwrite: bool,
    **choices: Any,  # noqa: ANN401 - fields of EstimateOptions
) -> None:
    """Find how a noisy photo lies to a blurred one.

    BLURRED was exposed long, NOISY briefly and at a high sensitivity, from the same place and at
    the same focal length. The registration file (.npz) says by which rotation the camera had moved
    between the two, how many times brighter BLURRED is, and how sure that is. Photos of different
    scenes are refused. Where nothing tells the focal length, a 50 mm equivalent is assumed.
    """
    from deshake.io.kernel_file import read_camera
    from deshake.pipelines.register import register_file, registration_name
    from deshake.pipelines.stages import EstimateOptions

    to_stdout = one_to_stdout(as_json=as_json, output=output, preview=preview)
    path = blurred.with_name(registration_name(blurred)) if output is None else output
    known = None if camera is None else read_camera(camera)
    options = EstimateOptions(camera=known, **choices)
    with context.bar(blurred.name) as bar:
        found = register_file(
            blurred,
            noisy,
            path,
            options,
            preview=preview,
            overwrite=overwrite,
            threads=context.threads,
            progress=bar,
        )
    if as_json:
        files = {"input": str(blurred), "noisy": str(noisy), "output": str(path)}
        if preview is not None:
            files["preview"] = str(preview)
        print_json(files | found.report())
    elif not to_stdout and context.verbosity >= 0:
        x, y, z = found.report()["theta_degrees"]
        scale, confidence = found.registration.scale, found.registration.confidence
        light = f"{scale:.3g} times darker" if scale >= 1 else f"{1 / scale:.3g} times brighter"
        click.echo(
            f"{noisy}: turned by {x:.2f}, {y:.2f}, {z:.2f} degrees about X, Y, Z; {light}; "
            f"confidence {confidence:.2f}"
        )
