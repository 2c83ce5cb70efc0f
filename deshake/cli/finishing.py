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


def finish_options(*, folder: bool = False) -> Callable[[F], F]:
    """Add --strength, --mask, --preview and --compare; `folder`: --mask also takes a folder."""
    kept = "A grey picture of the photo's size: white where the photo is to stay as it is"
    several = "; for several photos, a folder of such pictures, of the photos' names"
    options = (
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
            metavar="FILE|DIR" if folder else "FILE",
            help=f"{kept}{several if folder else ''}.  [default: nowhere]",
        ),
        click.option(
            "--strength",
            type=Share(),
            default=1.0,
            show_default=True,
            help="How much of the result to take, from 0 to 1; the rest is the photo.",
        ),
    )

    def add(command: F) -> F:
        for option in options:
            command = option(command)
        return command

    return add
