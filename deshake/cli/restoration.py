"""How a photo is deblurred, alone or with the help of a noisy one: options of two commands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import click

from deshake.cli.options import FILE, no_stdin

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from deshake.deconvolution.methods import RestorationOptions
    from deshake.pipelines.pair_deblurring import PairRestorationOptions

__all__ = ["check_pair", "noisy_option", "restoration", "restoration_options"]

F = TypeVar("F", bound="Callable[..., Any]")

_PAIR_METHODS = ("fusion", "residual")

noisy_option = click.option(
    "--noisy",
    type=FILE,
    callback=no_stdin,
    help="A sharp but noisy photo of the same scene, to deblur with the help of.",
)


def restoration_options(command: F) -> F:
    """Add how a photo is deblurred; `restoration` takes what they give.

    The method is None where none is given: its default depends on whether there is a noisy photo.
    """
    method = click.option(
        "--method",
        type=click.Choice(
            [
                "sparse",
                "rl",
                "rl-accelerated",
                "rl-tv",
                "wiener",
                "unsupervised-wiener",
                *_PAIR_METHODS,
            ]
        ),
        is_eager=True,  # the other two look at it
        help="How to deblur: by sparse gradients, by Richardson-Lucy (plain, accelerated or with "
        "total variation), or, if the blur is uniform, by Wiener filters. With --noisy: by fusion "
        "of both photos, or by residual Richardson-Lucy.  [default: sparse; with --noisy, fusion]",
    )
    quality = click.option(
        "--quality",
        type=click.Choice(["fast", "default", "high"]),
        default="default",
        show_default=True,
        callback=_goes_with("sparse", "fusion", None),
        help="How much time sparse takes: about 0.6, 1 or 1.4 times that of the default, and "
        "fusion: about 0.7, 1 or 1.5 times.",
    )
    iterations = click.option(
        "--iterations",
        type=click.IntRange(1, 10_000),
        metavar="N",
        callback=_goes_with(
            "sparse",
            "rl",
            "rl-accelerated",
            "rl-tv",
            "unsupervised-wiener",
            "fusion",
            "residual",
            None,
        ),
        help="Iterations of the method.  [default: 5 for sparse, 10 for fusion, "
        "else by the photo's noise]",
    )
    return method(quality(iterations(command)))


def restoration(
    noisy: Path | None,
    *,
    method: Any,  # noqa: ANN401 - of either kind, or None
    **choices: Any,  # noqa: ANN401 - fields of either kind
) -> RestorationOptions | PairRestorationOptions:
    """Return how a photo is deblurred, with a noisy one or alone.

    Raises
    ------
    click.UsageError
        If the method is one for the other case.

    """
    of_pair = method in _PAIR_METHODS
    if noisy is None:
        from deshake.deconvolution.methods import RestorationOptions

        if of_pair:
            raise click.UsageError(f"--method {method} needs --noisy.")
        return RestorationOptions(method or "sparse", **choices)
    from deshake.pipelines.pair_deblurring import PairRestorationOptions

    if not of_pair and method is not None:
        raise click.UsageError(f"--noisy does not go with --method {method}.")
    return PairRestorationOptions(method or "fusion", **choices)


def check_pair(photos: Sequence[Path], noisy: Path) -> None:
    """Refuse a noisy photo for several photos, and the photo itself.

    Raises
    ------
    click.UsageError
        If it is that.

    """
    if len(photos) > 1 or photos[0].is_dir():
        raise click.UsageError("one noisy photo goes with one blurred photo: take them in turn")
    [photo] = photos
    if noisy == photo or (noisy.exists() and photo.exists() and noisy.samefile(photo)):
        raise click.UsageError(f"{noisy} is the photo itself: name the noisy one with --noisy")


def _goes_with(*methods: str | None) -> Callable[[click.Context, click.Parameter, Any], Any]:
    """Make a callback that fails where the option was given with another --method."""

    def check(ctx: click.Context, param: click.Parameter, value: Any) -> Any:  # noqa: ANN401
        method = ctx.params.get("method")
        if value not in {None, param.default} and method not in methods:
            msg = f"{param.opts[-1]} does not go with --method {method}."
            raise click.UsageError(msg, ctx)
        return value

    return check
