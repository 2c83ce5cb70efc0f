"""The options that some commands share; `general_options` has those of all commands.

Options whose default or meaning differs from command to command are functions that return a
decorator; the others are decorators. Photos and files are plain paths: errors appear when they are
read.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from deshake.cli.values import Number, Region, Share

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.errors import DeshakeError
    from deshake.stages.estimate_options import EstimateOptions

__all__ = [
    "FILE",
    "blur_options",
    "camera_option",
    "chosen_estimate",
    "estimate_options",
    "estimator_option",
    "focal_options",
    "given_by",
    "in_folder",
    "json_option",
    "kernel_argument",
    "least_confidence_option",
    "left_out",
    "lens_options",
    "make_named_folder",
    "names_folder",
    "no_stdin",
    "one_pair",
    "one_to_stdout",
    "only_one_of",
    "only_with",
    "output_option",
    "overwrite_option",
    "photo_argument",
    "region_option",
    "search_angle_option",
    "transfer_option",
    "uniform_option",
]

F = TypeVar("F", bound="Callable[..., Any]")

FILE = click.Path(path_type=Path)
"""A path as it was typed; "-" is stdin or stdout where a command says so."""

_ENDS_WITH_SLASH = f"{__name__}: the output ends with a slash"

_CAMERA_CHOICES = ("focal", "focal_px", "focal_35mm", "lens", "lens_model")
_FOCAL_SOURCES = ("focal", "focal_px", "focal_35mm", "camera")


class _Output(click.Path):
    """A path for outputs; a slash at its end is kept for `names_folder`."""

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        """Read the path, and remember whether a slash ends it."""
        if ctx is not None:
            ctx.meta[_ENDS_WITH_SLASH] = str(value).endswith(("/", os.sep))
        return super().convert(value, param, ctx)


def names_folder(output: Path | None) -> bool:
    """Return whether -o names a folder, which need not exist if a slash ends its name."""
    if output is None:
        return False
    return output.is_dir() or click.get_current_context().meta.get(_ENDS_WITH_SLASH, False)


def in_folder(output: Path | None, name: Callable[[], str]) -> Path | None:
    """Return where an output goes whose default name is given: in the folder, if -o names one."""
    return output / name() if output is not None and names_folder(output) else output


def make_named_folder(output: Path | None, source: Path, error: type[DeshakeError]) -> None:
    """Make the folder that -o names, if it names one; first check that the input may be read.

    Raises
    ------
    DeshakeError
        Of the class `error`, if the input may not be read.
    OutputError
        If the folder cannot be made.

    """
    if output is None or not names_folder(output):
        return
    from deshake.files.disk import check_input
    from deshake.files.output_folder import make_folder

    check_input(source, error)
    make_folder(output)


def only_one_of(*names: str) -> Callable[[click.Context, click.Parameter, Any], Any]:
    """Make a callback that fails if a second one of the named options is given.

    The command line has priority over the environment, and that over the configuration file. If two
    options come from different places, the one of lower priority is left out.
    """

    def check(ctx: click.Context, param: click.Parameter, value: Any) -> Any:  # noqa: ANN401
        for name in names:
            if not value or name == param.name or not ctx.params.get(name):
                continue
            mine, other = given_by(ctx, param.name or ""), given_by(ctx, name)
            if mine == other:
                option = "--" + name.replace("_", "-")
                msg = f"{option} and {param.opts[-1]} cannot both be given."
                raise click.UsageError(msg, ctx)
            if mine > other:
                return None if value is not True else False
            ctx.params[name] = None if ctx.params[name] is not True else False
        return value

    return check


def only_with(*names: str) -> Callable[[click.Context, click.Parameter, Any], Any]:
    """Make a callback that leaves out a useless value of the configuration file.

    The value is useless without one of the named options. The command checks values that are typed.
    """

    def check(ctx: click.Context, param: click.Parameter, value: Any) -> Any:  # noqa: ANN401
        by_file = ctx.get_parameter_source(param.name or "") is ParameterSource.DEFAULT_MAP
        if by_file and not any(ctx.params.get(name) for name in names):
            return None if value is not True else False
        return value

    return check


def left_out(name: str, against: str) -> bool:
    """Return whether an option is left out: one that excludes it has a higher priority."""
    ctx = click.get_current_context()
    return given_by(ctx, name) > given_by(ctx, against)


def given_by(ctx: click.Context, name: str) -> int:
    """Return the place that the value of an option comes from, as a number: its priority."""
    source = ctx.get_parameter_source(name)
    return list(ParameterSource).index(source) if source is not None else len(ParameterSource)


def no_stdin(ctx: click.Context, param: click.Parameter, value: Any) -> Any:  # noqa: ANN401, ARG001
    """Refuse ``-`` for a photo, or among photos: a photo has a name, which its result takes."""
    names = value if isinstance(value, tuple) else (value,)
    if "-" in map(str, names):
        raise click.UsageError("photos are not read from standard input: name a file.", ctx)
    return value


def output_option(default: str, *, metavar: str = "FILE", note: str = "") -> Callable[[F], F]:
    """Add -o/--output; `default` says in words where the output goes without it."""
    return click.option(
        "-o",
        "--output",
        type=_Output(path_type=Path),
        metavar=metavar,
        help=f"Where to write{note}.  [default: {default}]",
    )


def one_to_stdout(*, as_json: bool, output: Path | None, **others: Path | None) -> bool:
    """Return whether one output goes to standard output; raise UsageError if several do.

    Each other output has the name of its option.
    """
    asked = {"--json": as_json, "-o -": str(output) == "-"}
    asked |= {f"--{name} -": str(path) == "-" for name, path in others.items()}
    names = [name for name, given in asked.items() if given]
    if len(names) > 1:
        raise click.UsageError(f"{' and '.join(names)} cannot go to standard output together.")
    return bool(names)


def one_pair(blurred: Path, noisy: Path) -> None:
    """Refuse a folder in the place of one of two photos.

    Raises
    ------
    click.UsageError
        If one of them is a folder.

    """
    for path in (blurred, noisy):
        if path.is_dir():
            raise click.UsageError(f"{path} is a folder: name one blurred and one noisy photo")


def focal_options(command: F) -> F:
    """Add --focal-px and --focal-35mm; the two exclude each other."""
    px = click.option(
        "--focal-px",
        type=Number("PIXELS"),
        callback=only_one_of(*_FOCAL_SOURCES),
        help="Focal length in pixels of this photo.  [default: from its EXIF]",
    )
    film = click.option(
        "--focal-35mm",
        type=Number("MILLIMETRES"),
        callback=only_one_of(*_FOCAL_SOURCES),
        help="Focal length in millimetres on 35 mm film.  [default: from the photo's EXIF]",
    )
    return px(film(command))


def lens_options(command: F) -> F:
    """Add --lens and --lens-model."""
    option = click.option(
        "--lens",
        is_flag=True,
        default=None,
        callback=only_one_of("camera", "focal"),
        help="Undo the distortion of the lens, by its profile in lensfun's database "
        "(deshake[lens]).",
    )
    named = click.option(
        "--lens-model",
        metavar="NAME",
        callback=only_one_of("camera", "focal"),
        help="The same, with the lens that has this name there.  [default: by the photo's EXIF]",
    )
    return option(named(command))


def blur_options(command: F) -> F:
    """Add --max-angle and --blur-size; the two exclude each other."""
    angle = click.option(
        "--max-angle",
        type=Number("DEGREES", most=45),
        callback=only_one_of("max_angle", "blur_size"),
        help="Largest rotation about any axis to look for.  [default: estimated from the photo]",
    )
    size = click.option(
        "--blur-size",
        type=Number("PIXELS"),
        callback=only_one_of("max_angle", "blur_size"),
        help="Largest blur to look for, in pixels of the photo.  "
        "[default: estimated from the photo]",
    )
    return angle(size(command))


photo_argument = click.argument("photo", type=FILE, callback=no_stdin)
kernel_argument = click.argument("kernel", type=FILE)

overwrite_option = click.option(
    "--overwrite",
    is_flag=True,
    callback=only_one_of("skip_existing"),
    help="Replace the output if it exists.",
)
transfer_option = click.option(
    "--transfer",
    type=click.Choice(["linear", "srgb", "gamma22"]),
    help="How the file's values stand for light.  [default: by its colour profile, else srgb]",
)
camera_option = click.option(
    "--camera",
    type=FILE,
    metavar="FILE.npz",
    callback=only_one_of(*_FOCAL_SOURCES, "lens", "lens_model"),
    help="Camera file written by calibrate, whose lens is undone if it bends.  [default: "
    "calibrate from the photo]",
)
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print the result to stdout, one JSON object a line."
)
search_angle_option = click.option(
    "--search-angle",
    type=Number("DEGREES", most=45),
    callback=only_with("noisy"),
    help="Largest rotation about any axis between the two photos that the registration looks for.  "
    "[default: 10]",
)
region_option = click.option(
    "--region",
    type=Region(),
    help="Estimate from this rectangle of the photo, in pixels.  [default: all of it]",
)
least_confidence_option = click.option(
    "--least-confidence",
    type=Share(),
    help="Deblur by any kernel of this confidence, 0 to 1, whatever the photo looks like; with 0, "
    "always.  [default: 0.5, or 0.8 if the photo has sharp edges; photos that look sharp or soft "
    "are left as they are]",
)
uniform_option = click.option(
    "--uniform",
    is_flag=True,
    help="Take the blur to be the same all over the frame, as if the camera only shifted.",
)


estimator_option = click.option(
    "--estimator",
    type=click.Choice(["edges", "variational"]),
    default="edges",
    show_default=True,
    help="Estimate by sharp edges, or by the paper's variational inference.",
)


focal_option = click.option(
    "--focal",
    type=click.Choice(["auto"]),
    callback=only_one_of(*_FOCAL_SOURCES, "lens", "lens_model"),
    help="Estimate the focal length with the kernel, whatever the metadata say. Without metadata "
    "this is the default.",
)


def chosen_estimate(
    camera: Path | None,
    **choices: Any,  # noqa: ANN401 - fields of EstimateOptions and of CameraChoice
) -> EstimateOptions:
    """Return the options of an estimate, from those of a command.

    Raises
    ------
    click.UsageError
        If the estimator cannot estimate the focal length, or leaves no photo as it is.
    KernelFileError
        If the camera file cannot be read.

    """
    from deshake.files.kernel_file import read_camera
    from deshake.stages.camera_choice import CameraChoice
    from deshake.stages.estimate_options import EstimateOptions

    names = [name for name in _CAMERA_CHOICES if name in choices]
    known = {name: choices.pop(name) for name in names}
    file = None if camera is None else read_camera(camera)
    if choices.get("estimator") == "variational":
        if known.get("focal") is not None:
            raise click.UsageError("--focal auto needs --estimator edges.")
        if choices.get("least_confidence") is not None:
            if not left_out("least_confidence", "estimator"):
                raise click.UsageError("--least-confidence needs --estimator edges.")
            choices["least_confidence"] = None
    return EstimateOptions(camera=CameraChoice(file=file, **known), **choices)


def estimate_options(command: F) -> F:
    """Add all options of a blind estimate; `chosen_estimate` takes their values."""
    for option in (
        transfer_option,
        estimator_option,
        uniform_option,
        least_confidence_option,
        region_option,
        blur_options,
        lens_options,
        focal_options,
        focal_option,
        camera_option,
    ):
        command = option(command)
    return command
