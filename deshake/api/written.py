"""Write photos, arrays and kernels to files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from deshake.api.arguments import check_kind
from deshake.api.pictures_in import as_photo
from deshake.errors import OutputError
from deshake.files.kernel_file import KernelFile
from deshake.files.kernel_file import write_kernel as write_kernel_file
from deshake.formats.photo import Photo
from deshake.formats.photo_writing import write_photo as write_photo_file
from deshake.geometry.kernel import RotationKernel
from deshake.stages.estimate_result import Estimate

if TYPE_CHECKING:
    import os

    from deshake.api.pictures_in import Picture

__all__ = ["write_kernel", "write_photo"]


def write_photo(path: str | os.PathLike[str], photo: Picture, *, overwrite: bool = False) -> None:
    """Write a photo to a file, whole or not at all.

    The file of a `Photo` has the permissions of the file that the photo was read from.

    Parameters
    ----------
    path : path
        The file; its ending names the format: .jpg, .png, .tif, .webp, .avif or .jp2.
    photo : Photo, or (H, W) or (H, W, 3) array of float
        The photo. If the ending does not change, a `Photo` keeps the format, depth and curve of its
        file. It takes its metadata along; what the format cannot hold is logged as a warning. An
        array is linear light, 0..1, and is written as sRGB: 16 bits in a PNG, TIFF or JPEG 2000,
        10 in an AVIF, 8 in a JPEG or WebP.
    overwrite : bool
        Whether an existing file may be replaced. The file that a `Photo` was read from never is.

    Raises
    ------
    OutputError
        If the file exists, or cannot be written, or its ending names no format.
    PhotoError
        If the format cannot hold the photo, or the array is not a picture in linear light.

    Examples
    --------
    >>> import numpy as np
    >>> import deshake
    >>> ramp = np.linspace(0, 1, 60 * 40).reshape(40, 60)
    >>> deshake.write_photo("ramp.png", ramp)
    >>> bool(abs(deshake.read_photo("ramp.png").pixels - ramp).max() < 1e-4)
    True

    """
    content = as_photo(photo)
    if not isinstance(photo, Photo):
        if not Path(path).suffix:
            raise OutputError("the name has no ending", hint="use .png or .jpg", file=path)
        content = replace(content, source=Path("the array.png"))
    inputs = [content.source] if isinstance(photo, Photo) else []
    write_photo_file(path, content, overwrite=overwrite, made_from=inputs)


def write_kernel(
    path: str | os.PathLike[str],
    kernel: RotationKernel | Estimate | KernelFile,
    *,
    overwrite: bool = False,
) -> None:
    """Write a kernel file, whole or not at all.

    Parameters
    ----------
    path : path
        The file; ``-`` for standard output.
    kernel : RotationKernel, Estimate or KernelFile
        The kernel. An estimate and the content of a kernel file have a confidence and a
        provenance; a kernel alone gets a confidence of 1 and no provenance.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        If the file exists or cannot be written.
    DeshakeError
        If there is no kernel to write.

    Examples
    --------
    >>> import deshake
    >>> camera = deshake.Camera.from_focal(900.0, height=480, width=720)
    >>> kernel = deshake.RotationKernel.from_path([(0, -0.01, 0), (0, 0.01, 0)], camera)
    >>> deshake.write_kernel("turn.npz", kernel)
    >>> (deshake.read_kernel("turn.npz").kernel.weights == kernel.weights).all()
    np.True_

    """
    if isinstance(kernel, Estimate):
        content = kernel.content
    elif isinstance(kernel, KernelFile):
        content = kernel
    else:
        content = KernelFile(
            check_kind(kernel, RotationKernel, "estimate_blind(...).kernel is one")
        )
    write_kernel_file(path, content, overwrite=overwrite)
