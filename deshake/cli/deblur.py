"""``deshake deblur``: deblur a photo whose blur kernel is known."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from deshake.cli.options import (
    FILE,
    general_options,
    kernel_argument,
    output_option,
    overwrite_option,
    photo_argument,
    restoration_options,
    transfer_option,
)

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.cli.context import Context
    from deshake.io.transfer import TransferName

__all__ = ["command"]

_PAIR_METHODS = ("fusion", "residual")


@click.command("deblur")
@photo_argument
@kernel_argument
@output_option("PHOTO's name with .deshaken before its ending")
@click.option(
    "--noisy",
    type=FILE,
    help="A sharp but noisy photo of the same scene, to deblur with the help of.",
)
@click.option(
    "--registration",
    type=FILE,
    metavar="FILE.npz",
    help="Registration file written by register, for --noisy.  [default: register the photos]",
)
@partial(restoration_options, pair=True)
@transfer_option
@overwrite_option
@general_options
@click.pass_obj
def command(
    context: Context,
    /,
    *,
    photo: Path,
    kernel: Path,
    output: Path | None,
    noisy: Path | None,
    registration: Path | None,
    method: Any,  # noqa: ANN401 - a method of either kind of options, or None
    transfer: TransferName | None,
    overwrite: bool,
    **choices: Any,  # noqa: ANN401 - fields of both kinds of options
) -> None:
    """Deblur a photo whose blur kernel is known.

    KERNEL is a kernel file (.npz), or - for standard input. It may have been made from PHOTO at
    another size. With --noisy it is that of estimate-pair: where nothing else is said, the photos
    are registered as they were there. The result has the format, depth and metadata of PHOTO.
    """
    of_pair = method in _PAIR_METHODS
    if noisy is None and (of_pair or registration is not None):
        raise click.UsageError(
            f"{f'--method {method}' if of_pair else '--registration'} needs --noisy."
        )
    if noisy is not None and not (of_pair or method is None):
        raise click.UsageError(f"--noisy does not go with --method {method}.")
    common: dict[str, Any] = {
        "transfer": transfer,
        "overwrite": overwrite,
        "threads": context.threads,
    }
    if noisy is not None:
        from deshake.pipelines.pair_deblurring import PairRestorationOptions, deblur_pair_file

        chosen = PairRestorationOptions(method or "fusion", **choices)
        run = partial(
            deblur_pair_file, photo, noisy, kernel, output, chosen, registration=registration
        )
    else:
        from deshake.deconvolution.methods import RestorationOptions
        from deshake.pipelines.file_stages import deblur_file

        single = RestorationOptions(method or "sparse", **choices)
        run = partial(deblur_file, photo, kernel, output, restoration=single)
    with context.bar(photo.name) as bar:
        run(**common, progress=bar)
