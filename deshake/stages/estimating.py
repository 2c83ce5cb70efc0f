"""The estimate from file to file: the work of ``estimate-blind`` and ``estimate-pair``.

All outputs are checked before the work begins, and appear whole or not at all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from deshake.files.disk import STREAM, check_output
from deshake.files.joint_outputs import joint_outputs
from deshake.files.kernel_file import kernel_bytes
from deshake.formats.conversion import output_format
from deshake.formats.photo import read_pair, read_photo
from deshake.formats.photo_writing import encode_photo
from deshake.pictures.latent_photo import latent_photo
from deshake.pictures.tile_picture import tile_photo
from deshake.run import Run
from deshake.signal.luminance import luminance
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.pair_estimate import estimate_pair
from deshake.stages.registering import known_registration

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.formats.encoding import Format
    from deshake.formats.photo import Photo
    from deshake.stages.estimate_options import EstimateOptions
    from deshake.stages.estimate_result import Estimate


__all__ = ["camera_name", "estimate_file", "kernel_name"]


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
    noisy: Path | None = None,
    registration: Path | None = None,
    latent: Path | None = None,
    tiles: Path | None = None,
    overwrite: bool = False,
    overwrite_others: bool = False,
    keep_result: bool = False,
    run: Run = Run(),
) -> Estimate:
    """Estimate the kernel of a photo, alone or with a noisy one, and write its kernel file.

    Parameters
    ----------
    source : Path
        The photo.
    output : Path
        The kernel file, or "-" for standard output.
    options : EstimateOptions
        Options of the estimate; with a noisy photo, region and estimator are ignored.
    noisy : Path, optional
        A noisy photo of the same scene.
    registration : Path, optional
        The registration file of the two photos; by default they are registered first.
    latent, tiles : Path, optional
        Paths of the latent picture of a blind estimate, and of the picture of its tiles. Both
        appear only together with the kernel.
    overwrite, overwrite_others : bool
        Whether an existing kernel file, or existing pictures, may be replaced.
    keep_result : bool
        Whether the kernel file exists already and is kept; only the pictures are written.
    run : Run, optional
        Threads to use, and who receives the progress.

    Raises
    ------
    PhotoError, CalibrationError, KernelFileError, EstimationError
        For the reasons of `read_photo`, `estimate_blind` and `estimate_pair`.
    OutputError
        If an output cannot be written.
    ValueError
        If there is a path for a picture of a blind estimate together with a noisy photo.

    """
    inputs = [path for path in (source, noisy, registration) if path is not None]
    check_output(output, *inputs, overwrite=overwrite or keep_result)
    pictures = [path for path in (latent, tiles) if path is not None]
    if noisy is not None:
        if pictures:
            raise ValueError("only a blind estimate has a latent picture and tiles")
        given = None if registration is None else known_registration(registration)
        estimate = estimate_pair(
            *read_pair(source, noisy, transfer=options.transfer),
            options,
            registration=given,
            run=run,
        )
        with joint_outputs(source, noisy) as add:
            if not keep_result:
                add(output, kernel_bytes(estimate.content), overwrite=overwrite)
        return estimate
    for number, path in enumerate(pictures):
        check_output(path, source, output, *pictures[:number], overwrite=overwrite_others)
    photo = _read(source, options, colours=tiles is not None)
    for path in pictures:
        _picture_format(path, photo)
    estimate = estimate_blind(photo, options, run=run)
    with joint_outputs(source) as add:

        def add_picture(path: Path, picture: Photo) -> None:
            data = encode_photo(picture, _picture_format(path, photo))
            add(path, data, overwrite=overwrite_others)

        if latent is not None and estimate.latent is not None:
            add_picture(latent, latent_photo(photo, estimate.latent, options.region))
        if tiles is not None:
            kernel, camera = estimate.content.kernel, estimate.camera.camera
            drawn = tile_photo(photo, kernel, camera, options.region, estimate.streaks)
            add_picture(tiles, drawn)
        if not keep_result:
            add(output, kernel_bytes(estimate.content), overwrite=overwrite)
    return estimate


def _read(source: Path, options: EstimateOptions, *, colours: bool) -> Photo:
    """Read a photo, or only its luminance, which takes a third of the memory."""
    return read_photo(source, transfer=options.transfer, reduction=None if colours else luminance)


def _picture_format(path: Path, photo: Photo) -> Format:
    """Return the format of a picture from its name; PNG for standard output."""
    return "PNG" if str(path) == STREAM else output_format(path, photo.source, photo.encoding)
