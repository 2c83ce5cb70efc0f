"""``deshake deblur``: deblur a photo whose blur kernel is known."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from deshake.cli.options import (
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


@click.command("deblur")
@photo_argument
@kernel_argument
@output_option("PHOTO's name with .deshaken before its ending")
@restoration_options
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
    transfer: TransferName | None,
    overwrite: bool,
    **choices: Any,  # noqa: ANN401 - the fields of RestorationOptions
) -> None:
    """Deblur a photo whose blur kernel is known.

    KERNEL is a kernel file (.npz), or - for standard input. It may have been made from PHOTO at
    another size. The result has the format, depth and metadata of PHOTO.
    """
    from deshake.deconvolution.methods import RestorationOptions
    from deshake.pipelines.file_stages import deblur_file

    with context.bar(photo.name) as bar:
        deblur_file(
            photo,
            kernel,
            output,
            transfer=transfer,
            restoration=RestorationOptions(**choices),
            overwrite=overwrite,
            threads=context.threads,
            progress=bar,
        )
