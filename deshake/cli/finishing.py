"""What is wanted of a result beside the deblurring: options of ``fix`` and ``deblur``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import click

from deshake.cli.options import FILE
from deshake.cli.values import Share

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["finish_options"]

F = TypeVar("F", bound="Callable[..., Any]")


def finish_options(command: F) -> F:
    """Add --strength, --mask, --preview, --compare and --keep-geometry."""
    for option in (
        click.option(
            "--keep-geometry",
            is_flag=True,
            help="Bend the result again as the photo was, where a lens is undone.  [default: leave "
            "it straight]",
        ),
        click.option(
            "--compare",
            is_flag=True,
            help="Also draw before and after on a sheet beside the result, called "
            "<its name>.compare.png.",
        ),
        click.option(
            "--preview",
            is_flag=True,
            help="Do all of it at a quarter of the photo's size, which takes seconds; a kernel "
            "that is kept fits the whole photo.",
        ),
        click.option(
            "--mask",
            type=FILE,
            metavar="FILE|DIR",
            help="A grey picture of the photo's size: white where the photo is to stay as it is; "
            "for several photos, a folder of such pictures, of the photos' names.  "
            "[default: nowhere]",
        ),
        click.option(
            "--strength",
            type=Share(),
            default=1.0,
            show_default=True,
            help="How much of the result to take, from 0 to 1; the rest is the photo.",
        ),
    ):
        command = option(command)
    return command
