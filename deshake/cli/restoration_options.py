"""The options of the deblurring, alone or with a noisy photo, for ``fix`` and ``deblur``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar, get_args

import click

from deshake.cli.options import FILE, given_by, no_stdin
from deshake.cli.values import Count
from deshake.restore.quality import Quality
from deshake.stages.methods import METHODS, RestorationOptions, default_method

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

__all__ = ["check_pair", "noisy_option", "restoration", "restoration_options"]

F = TypeVar("F", bound="Callable[..., Any]")

noisy_option = click.option(
    "--noisy",
    type=FILE,
    metavar="PHOTO",
    callback=no_stdin,
    help="A sharp but noisy photo of the same scene, to deblur with the help of.",
)


def restoration_options(command: F) -> F:
    """Add the options of the deblurring; `restoration` takes their values.

    Without --method the method is None: its default depends on whether there is a noisy photo.
    """
    method = click.option(
        "--method",
        type=click.Choice(list(METHODS)),
        metavar="METHOD",
        is_eager=True,  # the other two look at it
        help="How to deblur: sparse (as few edges as the photo allows), rl, rl-accelerated or "
        "rl-tv (Richardson-Lucy: plain, accelerated or with total variation); if the blur is the "
        "same all over, wiener or unsupervised-wiener; with --noisy, fusion (of both photos) or "
        "residual (Richardson-Lucy on their difference).  [default: "
        f"{default_method(noisy=False)}; with --noisy, {default_method(noisy=True)}]",
    )
    quality = click.option(
        "--quality",
        type=click.Choice(get_args(Quality)),
        default="default",
        show_default=True,
        callback=_goes_with_method,
        help="How much time sparse takes: about 0.6, 1 or 1.4 times that of the default, and "
        "fusion: about 0.7, 1 or 1.5 times.",
    )
    iterations = click.option(
        "--iterations",
        type=Count(1, 10_000),
        callback=_goes_with_method,
        help="Iterations of the method.  [default: 5 for sparse, or 10 if it does not "
        "settle, 10 for fusion, else by the photo's noise]",
    )
    return method(quality(iterations(command)))


def restoration(
    noisy: Path | None,
    *,
    method: str | None,
    **choices: Any,  # noqa: ANN401 - fields of RestorationOptions
) -> RestorationOptions:
    """Return the options of the deblurring, with a noisy photo or without.

    Raises
    ------
    click.UsageError
        If the method needs a noisy photo and there is none, or the other way round.

    """
    options = RestorationOptions(method or default_method(noisy=noisy is not None), **choices)
    if options.needs_noisy and noisy is None:
        raise click.UsageError(f"--method {method} needs --noisy.")
    if noisy is not None and not options.needs_noisy:
        raise click.UsageError(f"--noisy does not go with --method {method}.")
    return options


def check_pair(photos: Sequence[Path], noisy: Path) -> None:
    """Refuse a noisy photo for several photos, and the photo itself.

    Raises
    ------
    click.UsageError
        If there are several photos, or the noisy photo is the photo itself.

    """
    if len(photos) > 1 or photos[0].is_dir():
        raise click.UsageError("--noisy goes with one photo: run several one by one")
    [photo] = photos
    if noisy == photo or (noisy.exists() and photo.exists() and noisy.samefile(photo)):
        raise click.UsageError(f"{noisy} is the photo itself: name the noisy one with --noisy")


def _goes_with_method(ctx: click.Context, param: click.Parameter, value: Any) -> Any:  # noqa: ANN401
    """Fail if an option is given that the --method does not take.

    An option with a lower priority than the method, as from the configuration file, is left out.
    """
    method = ctx.params.get("method")
    given = value not in {None, param.default}
    if given and method is not None and param.name not in METHODS[method].options:
        if given_by(ctx, param.name or "") > given_by(ctx, "method"):
            return param.default
        msg = f"{param.opts[-1]} does not go with --method {method}."
        raise click.UsageError(msg, ctx)
    return value
