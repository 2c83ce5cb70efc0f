"""``deshake estimate-blind``: estimate the blur kernels of shaken photos."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from deshake.cli.batch import batch_options, photos_argument, planned, run_batch
from deshake.cli.general_options import general_options
from deshake.cli.option_groups import GroupedCommand
from deshake.cli.options import (
    FILE,
    chosen_estimate,
    estimate_options,
    one_to_stdout,
    output_option,
)

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.cli.batch import Batch
    from deshake.cli.context import Context

__all__ = ["command"]


@click.command("estimate-blind", cls=GroupedCommand)
@photos_argument
@output_option(
    "PHOTO's name with .kernel.npz",
    metavar="FILE.npz|DIR",
    note="; for several photos or a folder of them, a folder",
)
@click.option(
    "--latent",
    type=FILE,
    metavar="FILE.png",
    help="Also write the sharp picture that the kernel was estimated with: grey, of the region "
    "used, at the size worked on. For one photo.  [default: nowhere]",
)
@click.option(
    "--tiles",
    type=FILE,
    metavar="FILE.png",
    help="Also draw the photo with the tiles, or the streaks of lights, that the kernel was read "
    "from, and the local kernels there. For one photo.  [default: nowhere]",
)
@estimate_options
@batch_options
@general_options
@click.pass_obj
def command(
    context: Context,
    /,
    *,
    photos: tuple[Path, ...],
    output: Path | None,
    latent: Path | None,
    tiles: Path | None,
    camera: Path | None,
    batch: Batch,
    **choices: Any,  # noqa: ANN401 - what `chosen_estimate` takes
) -> int:
    """Estimate the blur kernels of shaken photos.

    A kernel says for how much of the exposure the camera stood at each rotation. It is estimated
    from the luminance of PHOTO, from coarse to fine, up to the size at which the shake is some 40
    pixels wide, and belongs to the photo at any size. A photo that looks sharp or merely soft gets
    the kernel of a camera that stood still. Where the focal length is unknown, it is
    estimated with the kernel. The photos of a folder are taken in natural order, with -r also those
    of the folders in it; if one fails, the others go on.
    """
    from deshake.batch.estimate_work import EstimateKernel
    from deshake.batch.plan import Extra
    from deshake.stages.estimating import kernel_name

    one_to_stdout(as_json=batch.as_json, output=output, latent=latent, tiles=tiles)
    pictures = {"latent": latent, "tiles": tiles}
    extras = {name: Extra(path) for name, path in pictures.items() if path is not None}
    jobs = planned(photos, output, batch, name=kernel_name, extras=extras)
    work = EstimateKernel(chosen_estimate(camera, **choices))
    return run_batch(context, jobs, work, batch)
