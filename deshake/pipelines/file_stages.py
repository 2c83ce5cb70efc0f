"""The stages from file to file: what the commands run.

Outputs are checked before any work is done for them, and appear whole or not at all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from deshake.deconvolution.methods import BY_DEFAULT, RestorationOptions
from deshake.errors import OutputError
from deshake.io.conversion import output_format
from deshake.io.files import STREAM, check_output, default_output
from deshake.io.joint_outputs import joint_outputs
from deshake.io.kernel_file import kernel_bytes, read_kernel
from deshake.io.photo import encode_photo, read_photo
from deshake.pipelines.finishing import AS_IT_IS, Finish
from deshake.pipelines.fitting import fitting_kernel
from deshake.pipelines.latent_picture import latent_photo
from deshake.pipelines.outputs import prepared, write_result
from deshake.pipelines.photo_provenance import photo_provenance
from deshake.pipelines.preview import preview_estimate
from deshake.pipelines.progress import part
from deshake.pipelines.stages import deblur, estimate
from deshake.pipelines.tile_picture import tile_photo

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.io.encoding import Format
    from deshake.io.photo import Photo
    from deshake.io.transfer import TransferName
    from deshake.pipelines.stages import Estimate, EstimateOptions

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
    overwrite_others: bool = False,
    keep_result: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Estimate the kernel of a photo, and write its kernel file.

    The latent picture of the estimate, if `latent` is given, and the picture of its tiles, if
    `tiles` is, appear only together with it. With `keep_result` the kernel file is there already,
    and stays as it is.

    Raises
    ------
    PhotoError, CalibrationError, KernelFileError, EstimationError
        For the reasons of `read_photo` and `estimate`.
    OutputError
        If an output cannot be written.

    """
    check_output(output, source, overwrite=overwrite or keep_result)
    pictures = [path for path in (latent, tiles) if path is not None]
    for number, path in enumerate(pictures):
        check_output(path, source, output, *pictures[:number], overwrite=overwrite_others)
    photo = read_photo(source, transfer=options.transfer)
    for path in pictures:
        _picture_format(path, photo)
    found = estimate(photo, options, threads=threads, progress=progress)
    with joint_outputs(source) as add:

        def keep(path: Path, picture: Photo) -> None:
            data = encode_photo(picture, _picture_format(path, photo))
            add(path, data, overwrite=overwrite_others)

        if latent is not None:
            keep(latent, latent_photo(photo, found.latent, options.region))
        if tiles is not None:
            kernel, camera = found.content.kernel, found.camera.camera
            keep(tiles, tile_photo(photo, kernel, camera, options.region))
        if not keep_result:
            add(output, kernel_bytes(found.content), overwrite=overwrite)
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
    overwrite_others: bool = False,
    keep_result: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Path:
    """Deblur a photo with the kernel of a file, write the result, and return where.

    Without `output`, or in that folder, the result is called ``<stem>.deshaken.<ext>``. The
    sheet of `finish` appears only together with it. With `keep_result` the result is there
    already, and stays as it is.

    Raises
    ------
    PhotoError, KernelFileError
        If the photo or the kernel cannot be read, or they do not fit each other.
    OutputError
        If the result cannot be written.

    """
    if output is not None and str(output) == STREAM:
        raise OutputError("photos are not written to standard output", hint="name a file with -o")
    path = default_output(source, output, overwrite=overwrite or keep_result)
    check_output(path, kernel_file, overwrite=overwrite or keep_result)
    finish.check(path, source, kernel_file, overwrite=overwrite_others)
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
        overwrite_others=overwrite_others,
        keep_result=keep_result,
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
    keep_result: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Estimate the kernel of a photo, deblur the photo with it, and write both.

    The kernel file, if `kernel_file` is given, and the sheet of `finish` appear only together
    with the photo. With `keep_result` the photo is there already, and stays as it is.

    Raises
    ------
    PhotoError, CalibrationError, KernelFileError, EstimationError
        For the reasons of `read_photo` and `estimate`.
    OutputError
        If an output cannot be written.

    """
    check_output(output, source, overwrite=overwrite or keep_result)
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
        keep_result=keep_result,
    )
    return found


def _picture_format(path: Path, photo: Photo) -> Format:
    """Return the format of a picture of an estimate: by its name, PNG for standard output."""
    return "PNG" if str(path) == STREAM else output_format(path, photo)
