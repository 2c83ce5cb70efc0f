"""``deshake estimate-pair``: estimate a blur kernel from a blurred and a noisy photo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from deshake.cli.json_output import print_json
from deshake.cli.options import (
    FILE,
    blur_options,
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
    uniform_option,
)

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.cli.context import Context

__all__ = ["command"]

_NOT_WITH_REGISTRATION = ("camera", "focal_px", "focal_35mm", "lens", "lens_model")


@click.command("estimate-pair")
@click.argument("blurred", type=FILE, callback=no_stdin)
@click.argument("noisy", type=FILE, callback=no_stdin)
@output_option("BLURRED's name with .kernel.npz", metavar="FILE.npz")
@click.option(
    "--registration",
    type=FILE,
    metavar="FILE.npz",
    help="Registration file written by register, with the camera to go by.  [default: register "
    "the photos]",
)
@camera_option
@focal_options
@lens_options
@blur_options
@uniform_option
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
    registration: Path | None,
    camera: Path | None,
    as_json: bool,
    overwrite: bool,
    **choices: Any,  # noqa: ANN401 - fields of EstimateOptions
) -> None:
    """Estimate a blur kernel from a blurred and a noisy photo.

    BLURRED was exposed long, NOISY briefly and sharply, from the same place and with the same
    lens. NOISY may be much darker and turned by some degrees. The kernel is for BLURRED, in the
    frame of the registered NOISY. Where nothing tells the focal length, a 50 mm equivalent is
    assumed.
    """
    from deshake.io.kernel_file import read_camera
    from deshake.pipelines.file_stages import kernel_name
    from deshake.pipelines.pair_stages import estimate_pair_file
    from deshake.pipelines.stages import EstimateOptions

    one_to_stdout(as_json=as_json, output=output)
    for name, value in {"camera": camera, **choices}.items():
        if registration is not None and name in _NOT_WITH_REGISTRATION and value is not None:
            option = "--" + name.replace("_", "-")
            raise click.UsageError(f"--registration and {option} cannot both be given.")
    path = blurred.with_name(kernel_name(blurred)) if output is None else output
    known = None if camera is None else read_camera(camera)
    options = EstimateOptions(camera=known, **choices)
    with context.bar(blurred.name) as bar:
        found = estimate_pair_file(
            blurred,
            noisy,
            path,
            options,
            registration=registration,
            overwrite=overwrite,
            threads=context.threads,
            progress=bar,
        )
    if as_json:
        files = {"input": str(blurred), "noisy": str(noisy), "output": str(path)}
        print_json(files | found.report())
