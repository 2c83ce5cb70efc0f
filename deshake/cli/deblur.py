"""``deshake deblur``: deblur a photo whose blur kernel is known."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from deshake.cli.finishing import finish_options
from deshake.cli.options import (
    FILE,
    general_options,
    kernel_argument,
    linear_option,
    output_option,
    overwrite_option,
    photo_argument,
    provenance_option,
    transfer_option,
)
from deshake.cli.restoration import noisy_option, restoration, restoration_options

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.cli.context import Context
    from deshake.io.transfer import TransferName

__all__ = ["command"]


@click.command("deblur")
@photo_argument
@kernel_argument
@output_option("PHOTO's name with .deshaken before its ending")
@noisy_option
@click.option(
    "--registration",
    type=FILE,
    metavar="FILE.npz",
    help="Registration file written by register, for --noisy.  [default: register the photos]",
)
@restoration_options
@finish_options()
@transfer_option
@linear_option
@provenance_option
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
    transfer: TransferName | None,
    strength: float,
    mask: Path | None,
    preview: bool,
    compare: bool,
    linear: bool,
    no_provenance: bool,
    overwrite: bool,
    **choices: Any,  # noqa: ANN401 - how to deblur
) -> None:
    """Deblur a photo whose blur kernel is known.

    KERNEL is a kernel file (.npz), or - for standard input. It may have been made from PHOTO at
    another size. With --noisy it is that of estimate-pair: where nothing else is said, the photos
    are registered as they were there. The result has the format, depth and metadata of PHOTO,
    and tells in them how it came about.
    """
    if noisy is None and registration is not None:
        raise click.UsageError("--registration needs --noisy.")
    from deshake.pipelines.finishing import Finish

    chosen: Any = restoration(noisy, **choices)
    common: dict[str, Any] = {
        "transfer": transfer,
        "finish": Finish(strength, mask, preview, compare),
        "linear": linear,
        "provenance": not no_provenance,
        "overwrite": overwrite,
        "threads": context.threads,
    }
    if noisy is not None:
        from deshake.pipelines.pair_deblurring import deblur_pair_file

        run = partial(
            deblur_pair_file, photo, noisy, kernel, output, chosen, registration=registration
        )
    else:
        from deshake.pipelines.file_stages import deblur_file

        run = partial(deblur_file, photo, kernel, output, restoration=chosen)
    with context.bar(photo.name) as bar:
        run(**common, progress=bar)
