"""``deshake simulate``: shake a sharp photo by a known rotation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from deshake.cli.file_options import (
    NO_JPEG,
    check_ending,
    chosen_format,
    format_option,
    is_typed,
    quality_option,
)
from deshake.cli.general_options import general_options
from deshake.cli.option_groups import GroupedCommand
from deshake.cli.options import (
    FILE,
    camera_option,
    focal_options,
    in_folder,
    lens_options,
    make_named_folder,
    output_option,
    overwrite_option,
    photo_argument,
    transfer_option,
)
from deshake.cli.values import Count, Number, Share

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.cli.context import Context

__all__ = ["command"]

_BLUR_PX = 20.0  # px: extent of a random blur, if none is given


@click.command(
    "simulate",
    cls=GroupedCommand,
    groups={
        "Every day": ("--output", "--kernel", "--sharp"),
        "Shaking": ("--blur-size", "--path", "--seed", "--crop"),
        "Exposing": ("--gain", "--noise", "--photons"),
    },
)
@photo_argument
@output_option("PHOTO's name with .shaken before its ending", note=" the shaken photo")
@click.option(
    "--kernel",
    type=FILE,
    metavar="FILE.npz",
    help="Where to write the true kernel; - is standard output.  "
    "[default: the shaken photo's name with .npz]",
)
@click.option(
    "--sharp",
    type=FILE,
    metavar="FILE",
    help="Where to write the sharp photo in the frame of the shaken one.  [default: nowhere]",
)
@click.option(
    "--path",
    type=FILE,
    metavar="FILE",
    help="How the camera turns: a text file of rows rx,ry,rz or t,rx,ry,rz, in degrees about X "
    "(right), Y (down) and Z (into the scene).  [default: at random]",
)
@click.option(
    "--blur-size",
    "blur_px",
    type=Number("PIXELS"),
    help=f"Extent of the random blur over the frame, in pixels.  [default: {_BLUR_PX:g}]",
)
@click.option(
    "--seed",
    type=Count(0, 2**32 - 1),
    default=0,
    show_default=True,
    help="Seed of the random path and of the noise.",
)
@click.option(
    "--noise",
    "noise_sigma",
    type=Share(),
    help="Read noise: its standard deviation as a share of the clip level, as in 0.01 or 1%.  "
    "[default: none]",
)
@click.option(
    "--photons",
    type=Number("PHOTONS", most=1e12),
    help="Shot noise: photons that fill a pixel to the clip level.  [default: no shot noise]",
)
@click.option(
    "--gain",
    type=Number("FACTOR", most=1000),
    default=1.0,
    show_default=True,
    help="Factor on the light, after the blur; above 1, lights clip.",
)
@click.option(
    "--crop/--keep-size",
    default=True,
    show_default="crop",
    help="Cut off the borders, whose blur reaches beyond the photo, or continue the photo there.",
)
@focal_options
@lens_options
@camera_option
@transfer_option
@format_option
@quality_option
@overwrite_option
@general_options
@click.pass_obj
def command(
    context: Context,
    /,
    photo: Path,
    *,
    output: Path | None,
    path: Path | None,
    blur_px: float | None,
    noise_sigma: float | None,
    jpeg_quality: int | None,
    **options: Any,  # noqa: ANN401
) -> None:
    """Shake a sharp photo by a known rotation.

    Blurs PHOTO as a camera does that turns while the shutter is open, and writes the shaken
    photo and the true blur kernel: a test case whose answer is known. The light is blurred, then
    exposed with noise and clipping; the output has PHOTO's format, depth and metadata. With a lens
    that bends, PHOTO is taken to be straight, and is bent after the shake.
    """
    if path is not None and blur_px is not None:
        raise click.UsageError("--path and --blur-size cannot both be given.")
    from deshake.errors import PhotoError
    from deshake.simulation.shaken_photo import shaken_name, simulate_file
    from deshake.stages.result_file import ResultFile

    file = ResultFile(form=chosen_format(options.pop("format"), output), jpeg_quality=jpeg_quality)
    place = in_folder(output, lambda: shaken_name(photo, file.form).name)
    if place is not None:
        check_ending(place, file)
    sharp_is_jpeg = options["sharp"] is not None and ResultFile().is_jpeg(options["sharp"])
    is_jpeg = file.is_jpeg(place or shaken_name(photo, file.form)) or sharp_is_jpeg
    if jpeg_quality is not None and not is_jpeg and is_typed("jpeg_quality"):
        raise click.UsageError(NO_JPEG)
    make_named_folder(output, photo, PhotoError)
    with context.bar("shaking") as bar:
        simulate_file(
            photo,
            place,
            path=path,
            blur_px=_BLUR_PX if blur_px is None else blur_px,
            noise_sigma=noise_sigma or 0.0,
            file=file,
            run=context.run(bar),
            **options,
        )
