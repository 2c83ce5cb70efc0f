"""Options of a result beside the deblurring, for ``fix`` and ``deblur``."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from deshake.cli.options import FILE, no_stdin
from deshake.cli.values import Share

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["finish_options"]

F = TypeVar("F", bound="Callable[..., Any]")


def finish_options(command: F) -> F:
    """Add the options of `FinishingOptions`, passed as ``finish``; --mask is passed separately."""

    @wraps(command)
    def collected(
        *args: Any,  # noqa: ANN401
        no_provenance: bool,
        **values: Any,  # noqa: ANN401
    ) -> Any:  # noqa: ANN401
        from deshake.stages.finishing import FinishingOptions

        names = "strength", "preview", "compare", "keep_geometry", "linear"
        given = {name: values.pop(name) for name in names}
        finish = FinishingOptions(**given, with_provenance=not no_provenance)
        return command(*args, finish=finish, **values)

    for option in (
        click.option(
            "--no-provenance",
            is_flag=True,
            help="Add nothing to the photo's metadata about how it was deblurred.",
        ),
        click.option(
            "--linear",
            is_flag=True,
            help="Write the result of a RAW file in linear light and the sensor's colours.  "
            "[default: in sRGB]",
        ),
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
            callback=no_stdin,
            metavar="FILE|DIR",
            help="A grey picture of the photo's size: white where the photo is to stay as it is; "
            "for several photos, a folder of such pictures, of the photos' names.  "
            "[default: nowhere]",
        ),
        click.option(
            "--strength",
            type=Share(),
            default=1.0,
            help="How much of the result to take, as in 0.8 or 80%; the rest is the photo.  "
            "[default: 1]",
        ),
    ):
        collected = option(collected)
    return cast("F", collected)
