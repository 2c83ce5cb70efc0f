"""The stages from file to file: what the commands run.

Outputs are checked before any work is done for them, and appear whole or not at all.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from deshake.errors import OutputError
from deshake.files.disk import STREAM, check_output, write_bytes
from deshake.files.kernel_file import read_kernel, write_kernel
from deshake.formats.conversion import output_format
from deshake.formats.output_names import default_output
from deshake.formats.photo import encode_photo, read_photo
from deshake.pictures.latent_photo import latent_photo
from deshake.pictures.tile_picture import tile_photo
from deshake.restore.methods import BY_DEFAULT, RestorationOptions
from deshake.stages.finishing import AS_IT_IS, Finish
from deshake.stages.fitting import fitting_kernel
from deshake.stages.outputs import gone_on_failure, prepared, write_result
from deshake.stages.photo_provenance import photo_provenance
from deshake.stages.preview import preview_estimate
from deshake.stages.progress import part
from deshake.stages.stages import deblur, estimate

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.formats.encoding import Format
    from deshake.formats.photo import Photo
    from deshake.formats.transfer import TransferName
    from deshake.stages.estimate_options import EstimateOptions
    from deshake.stages.stages import Estimate

    Progress = Callable[[float, str], None]

__all__ = [
    "camera_name",
    "deblur_file",
    "estimate_file",
    "fix_file",
    "kernel_name",
]

_ESTIMATE_PIXELS = 8e6
"""Pixels whose deblurring takes about as long as an estimate, which has a size of its own."""


def kernel_name(source: Path) -> str:
    """Return the default name of a photo's kernel: ``<stem>.kernel.npz``."""
    return f"{source.stem}.kernel.npz"


def camera_name(source: Path) -> str:
    """Return the default name of a photo's camera: ``<stem>.camera.npz``."""
    return f"{source.stem}.camera.npz"


def estimate_file(
    source: Path,
    output: Path,
    options: EstimateOptions,
    *,
    latent: Path | None = None,
    tiles: Path | None = None,
    overwrite: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Estimate the kernel of a photo, and write its kernel file.

    The latent picture of the estimate, if `latent` is given, and the picture of its tiles, if
    `tiles` is, are kept only together with it.

    Raises
    ------
    PhotoError, CalibrationError, KernelFileError, EstimationError
        For the reasons of `read_photo` and `estimate`.
    OutputError
        If an output cannot be written.

    """
    check_output(output, source, overwrite=overwrite)
    pictures = [path for path in (latent, tiles) if path is not None]
    for number, path in enumerate(pictures):
        check_output(path, source, output, *pictures[:number], overwrite=overwrite)
    photo = read_photo(source, transfer=options.transfer)
    for path in pictures:
        _picture_format(path, photo)
    found = estimate(photo, options, threads=threads, progress=progress)
    with contextlib.ExitStack() as outputs:

        def keep(path: Path, picture: Photo) -> None:
            outputs.enter_context(gone_on_failure(path))
            write_bytes(
                path, encode_photo(picture, _picture_format(path, photo)), overwrite=overwrite
            )

        if latent is not None:
            keep(latent, latent_photo(photo, found.latent, options.region))
        if tiles is not None:
            kernel, camera = found.content.kernel, found.camera.camera
            keep(tiles, tile_photo(photo, kernel, camera, options.region))
        write_kernel(output, found.content, overwrite=overwrite)
    return found


def deblur_file(
    source: Path,
    kernel_file: Path,
    output: Path | None,
    *,
    transfer: TransferName | None = None,
    restoration: RestorationOptions = BY_DEFAULT,
    finish: Finish = AS_IT_IS,
    overwrite: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Path:
    """Deblur a photo with the kernel of a file, write the result, and return where.

    Without `output`, or in that folder, the result is called ``<stem>.deshaken.<ext>``. The
    sheet of `finish` is kept only together with it.

    Raises
    ------
    PhotoError, KernelFileError
        If the photo or the kernel cannot be read, or they do not fit each other.
    OutputError
        If the result cannot be written.

    """
    if output is not None and str(output) == STREAM:
        raise OutputError("photos are not written to standard output", hint="name a file with -o")
    path = default_output(source, output, overwrite=overwrite)
    check_output(path, kernel_file, overwrite=overwrite)
    finish.check(path, source, kernel_file, overwrite=overwrite)
    content = read_kernel(kernel_file)
    photo = read_photo(source, transfer=transfer)
    photo, mask = finish.prepare(prepared(photo, path, finish))
    kernel = fitting_kernel(content, photo, kernel_file)
    result = deblur(
        photo,
        kernel,
        restoration,
        keep_geometry=finish.keep_geometry,
        threads=threads,
        progress=progress,
    )
    told = photo_provenance(photo, content, restoration, transfer=transfer, finish=finish)
    write_result(
        path,
        result,
        photo,
        mask,
        kernel,
        finish=finish,
        provenance=told,
        overwrite=overwrite,
        overwrite_others=overwrite,
    )
    return path


def fix_file(
    source: Path,
    output: Path,
    kernel_file: Path | None,
    options: EstimateOptions,
    *,
    restoration: RestorationOptions = BY_DEFAULT,
    finish: Finish = AS_IT_IS,
    overwrite: bool = False,
    overwrite_others: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Estimate the kernel of a photo, deblur the photo with it, and write both.

    The kernel file, if `kernel_file` is given, and the sheet of `finish` are kept only together
    with the photo.

    Raises
    ------
    PhotoError, CalibrationError, KernelFileError, EstimationError
        For the reasons of `read_photo` and `estimate`.
    OutputError
        If an output cannot be written.

    """
    check_output(output, source, overwrite=overwrite)
    if kernel_file is not None:
        check_output(kernel_file, source, output, overwrite=overwrite_others)
    finish.check(output, source, *filter(None, [kernel_file]), overwrite=overwrite_others)
    photo = read_photo(source, transfer=options.transfer)
    whole = prepared(photo, output, finish)
    photo, mask = finish.prepare(whole)
    pixels = photo.shape[0] * photo.shape[1]
    share = _ESTIMATE_PIXELS / (_ESTIMATE_PIXELS + pixels)
    first, second = part(progress, 0, share), part(progress, share, 1)
    if finish.preview:
        found = preview_estimate(whole, photo, options, threads=threads, progress=first)
    else:
        found = estimate(photo, options, threads=threads, progress=first)
    del whole
    kernel = found.content.kernel
    result = deblur(
        photo,
        kernel,
        restoration,
        keep_geometry=finish.keep_geometry,
        threads=threads,
        progress=second,
    )
    told = photo_provenance(
        photo, found.content, restoration, transfer=options.transfer, finish=finish
    )
    write_result(
        output,
        result,
        photo,
        mask,
        kernel,
        finish=finish,
        provenance=told,
        kept=None if kernel_file is None else (kernel_file, found.content),
        overwrite=overwrite,
        overwrite_others=overwrite_others,
    )
    return found


def _picture_format(path: Path, photo: Photo) -> Format:
    """Return the format of a picture of an estimate: by its name, PNG for standard output."""
    return "PNG" if str(path) == STREAM else output_format(path, photo.source, photo.encoding)
