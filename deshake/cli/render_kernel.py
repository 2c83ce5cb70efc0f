"""``deshake render-kernel``: draw a blur kernel as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from deshake.cli.general_options import general_options
from deshake.cli.option_groups import GroupedCommand
from deshake.cli.options import (
    in_folder,
    kernel_argument,
    make_named_folder,
    output_option,
    overwrite_option,
)
from deshake.cli.values import Count, Grid

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["command"]


@click.command("render-kernel", cls=GroupedCommand, groups={"The picture": ("--filters", "--size")})
@kernel_argument
@output_option("KERNEL's name with .png, or with -filters.png", metavar="FILE.png")
@click.option(
    "--filters",
    type=Grid(),
    help="Draw this many local filters over the frame instead of the rotation cuboid.",
)
@click.option(
    "--size",
    type=Count(200, 8000, "PIXELS"),
    help="Longer side of the picture.  [default: 640, or 960 with --filters]",
)
@overwrite_option
@general_options
def command(
    kernel: Path,
    output: Path | None,
    filters: tuple[int, int] | None,
    size: int | None,
    *,
    overwrite: bool,
) -> None:
    """Draw a blur kernel as a picture.

    KERNEL is a kernel file (.npz), or - for standard input. The picture shows the rotations as
    points in a cuboid whose sides are the rotations about X, Y and Z, with the sums of their
    weights on the faces behind; or, with --filters, what becomes of point lights in each part
    of the frame.
    """
    from deshake.errors import KernelFileError
    from deshake.pictures.render import picture_name, render_file

    place = in_folder(output, lambda: picture_name(kernel, filters=filters is not None))
    make_named_folder(output, kernel, KernelFileError)
    render_file(kernel, place, filters=filters, size=size, overwrite=overwrite)
