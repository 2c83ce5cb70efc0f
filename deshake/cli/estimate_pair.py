"""``deshake estimate-pair``: estimate a blur kernel from a blurred and a noisy photo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from deshake.cli.batch import frame_options, planned, run_batch
from deshake.cli.general_options import general_options
from deshake.cli.option_groups import GroupedCommand
from deshake.cli.options import (
    FILE,
    blur_options,
    camera_option,
    chosen_estimate,
    focal_options,
    least_confidence_option,
    left_out,
    lens_options,
    no_stdin,
    one_pair,
    one_to_stdout,
    output_option,
    search_angle_option,
    transfer_option,
    uniform_option,
)

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.cli.batch import Batch
    from deshake.cli.context import Context

__all__ = ["command"]

_NOT_WITH_REGISTRATION = ("camera", "focal_px", "focal_35mm", "lens", "lens_model", "search_angle")


@click.command("estimate-pair", cls=GroupedCommand)
@click.argument("blurred", type=FILE, callback=no_stdin)
@click.argument("noisy", type=FILE, callback=no_stdin)
@output_option("BLURRED's name with .kernel.npz", metavar="FILE.npz")
@click.option(
    "--registration",
    type=FILE,
    metavar="FILE.npz",
    help="Registration file written by register, whose camera is used, too.  [default: register "
    "the photos]",
)
@search_angle_option
@camera_option
@focal_options
@lens_options
@blur_options
@uniform_option
@least_confidence_option
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
    registration: Path | None,
    camera: Path | None,
    batch: Batch,
    **choices: Any,  # noqa: ANN401 - what `chosen_estimate` takes
) -> int:
    """Estimate a blur kernel from a blurred and a noisy photo.

    BLURRED was exposed long, NOISY briefly and sharply, from the same place and with the same
    lens. NOISY may be much darker and turned by some degrees. The kernel is for BLURRED, in the
    frame of the registered NOISY. Where the focal length is unknown, a 50 mm equivalent is
    assumed.
    """
    from deshake.batch.estimate_work import EstimateKernel
    from deshake.stages.estimating import kernel_name

    one_to_stdout(as_json=batch.as_json, output=output)
    one_pair(blurred, noisy)
    choices["camera"] = camera
    for name in _NOT_WITH_REGISTRATION:
        if registration is None or choices[name] is None:
            continue
        if left_out(name, "registration"):
            choices[name] = None
        else:
            option = "--" + name.replace("_", "-")
            raise click.UsageError(f"--registration and {option} cannot both be given.")
    jobs = planned(
        [blurred],
        output,
        batch,
        name=kernel_name,
        needs={"noisy": lambda _: noisy, "registration": lambda _: registration},
    )
    return run_batch(context, jobs, EstimateKernel(chosen_estimate(**choices)), batch)
