"""``deshake estimate-blind``: estimate the blur kernel of a shaken photo."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from deshake.cli.options import (
    FILE,
    estimate_options,
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


@click.command("estimate-blind")
@photo_argument
@output_option("PHOTO's name with .kernel.npz", metavar="FILE.npz")
@click.option(
    "--latent",
    type=FILE,
    metavar="FILE.png",
    help="Also write the sharp picture that the kernel was estimated with: grey, of the region "
    "used, at the size worked on.  [default: nowhere]",
)
@estimate_options
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
    latent: Path | None,
    camera: Path | None,
    as_json: bool,
    overwrite: bool,
    **choices: Any,  # noqa: ANN401 - the fields of EstimateOptions
) -> None:
    """Estimate the blur kernel of a shaken photo.

    The kernel says for how much of the exposure the camera stood at each rotation. It is
    estimated from the luminance of PHOTO, from coarse to fine, at a working resolution of its
    own, and belongs to the photo at any size. Where nothing tells the focal length, a 50 mm
    equivalent is assumed.
    """
    from deshake.io.kernel_file import read_camera
    from deshake.pipelines.file_stages import estimate_file, kernel_name
    from deshake.pipelines.stages import EstimateOptions

    one_to_stdout(as_json=as_json, output=output, latent=latent)
    path = photo.with_name(kernel_name(photo)) if output is None else output
    known = None if camera is None else read_camera(camera)
    options = EstimateOptions(camera=known, **choices)
    with context.bar(photo.name) as bar:
        found = estimate_file(
            photo,
            path,
            options,
            latent=latent,
            overwrite=overwrite,
            threads=context.threads,
            progress=bar,
        )
    if as_json:
        files = {"input": str(photo), "output": str(path)}
        if latent is not None:
            files["latent"] = str(latent)
        click.echo(json.dumps(files | found.report()))
