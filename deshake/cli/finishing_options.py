"""Options of a result beside the deblurring, for ``fix`` and ``deblur``."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from deshake.cli.options import FILE, no_stdin, only_with
from deshake.cli.values import Share

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.batch.plan import Extra

__all__ = ["finish_options", "moving_masks"]

F = TypeVar("F", bound="Callable[..., Any]")


def finish_options(command: F) -> F:
    """Add the options of `FinishingOptions`, passed as ``finish``.

    --mask and --keep-masks are passed separately.
    """

    @wraps(command)
    def collected(
        *args: Any,  # noqa: ANN401
        no_provenance: bool,
        **values: Any,  # noqa: ANN401
    ) -> Any:  # noqa: ANN401
        from deshake.stages.finishing import FinishingOptions

        names = "strength", "preview", "protect_moving", "compare", "keep_geometry", "linear"
        given = {name: values.pop(name) for name in names}
        if values["keep_masks"] is not None and not given["protect_moving"]:
            raise click.UsageError("--keep-masks needs --protect-moving.")
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
            "--keep-masks",
            type=FILE,
            metavar="DIR",
            callback=only_with("protect_moving"),
            help="Write the mask of --protect-moving for each photo into this folder, as --mask "
            "takes it.",
        ),
        click.option(
            "--protect-moving",
            is_flag=True,
            is_eager=True,  # --keep-masks looks at it
            help="Keep the photo where its blur is not that of the camera: people, cars and water "
            "that moved.",
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


def moving_masks(folder: Path | None) -> dict[str, Extra]:
    """Return the masks of moving parts as outputs beside the results, if they are kept."""
    if folder is None:
        return {}
    from deshake.batch.plan import Extra
    from deshake.stages.blending import mask_name

    return {"moving_mask": Extra(folder, mask_name)}
