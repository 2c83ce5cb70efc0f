"""``deshake register``: find how a noisy photo lies to a blurred one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from deshake.cli.batch import frame_options, planned, run_batch
from deshake.cli.general_options import general_options
from deshake.cli.option_groups import GroupedCommand
from deshake.cli.options import (
    FILE,
    camera_option,
    chosen_estimate,
    focal_options,
    lens_options,
    no_stdin,
    one_pair,
    one_to_stdout,
    output_option,
    search_angle_option,
    transfer_option,
)

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.batch.task import Result
    from deshake.cli.batch import Batch
    from deshake.cli.context import Context

__all__ = ["command"]


@click.command("register", cls=GroupedCommand)
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
@search_angle_option
@camera_option
@focal_options
@lens_options
@transfer_option
@frame_options
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
    batch: Batch,
    **choices: Any,  # noqa: ANN401 - what `chosen_estimate` takes
) -> int:
    """Find how a noisy photo lies to a blurred one.

    BLURRED was exposed long, NOISY briefly and at a high sensitivity, from the same place and at
    the same focal length. The registration file (.npz) says by which rotation the camera had moved
    between the two, how many times brighter BLURRED is, and how sure that is. Photos of different
    scenes are refused. Where the focal length is unknown, a 50 mm equivalent is assumed.
    """
    from deshake.batch.estimate_work import Register
    from deshake.batch.plan import Extra
    from deshake.stages.registering import registration_name

    to_stdout = one_to_stdout(as_json=batch.as_json, output=output, preview=preview)
    one_pair(blurred, noisy)
    jobs = planned(
        [blurred],
        output,
        batch,
        name=registration_name,
        extras={} if preview is None else {"preview": Extra(preview)},
        needs={"noisy": lambda _: noisy},
    )
    silent = to_stdout or context.verbosity < 0
    work = Register(chosen_estimate(camera, **choices))
    return run_batch(context, jobs, work, batch, None if silent else _line)


def _line(result: Result) -> str:
    """Return the registration in one line."""
    figures = result.figures
    x, y, z = figures["theta_degrees"]
    scale = figures["scale"]
    light = f"{scale:.3g} times darker" if scale >= 1 else f"{1 / scale:.3g} times brighter"
    return (
        f"{result.job.needs['noisy']}: turned by {x:.2f}, {y:.2f}, {z:.2f} degrees about X, Y, Z; "
        f"{light}; confidence {figures['confidence']:.2f}"
    )
