"""The registration of a blurred and a noisy photo: the work of ``register``."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deshake.errors import CalibrationError, DeshakeError, PhotoError
from deshake.files.disk import STREAM, check_output
from deshake.files.joint_outputs import joint_outputs
from deshake.files.registration_file import RegistrationFile, read_registration, registration_bytes
from deshake.formats.conversion import output_format
from deshake.formats.encoding import Encoding
from deshake.formats.photo import read_pair
from deshake.formats.photo_writing import encode_photo
from deshake.lens.straightening import straight_pair
from deshake.metadata.metadata import Metadata
from deshake.pair.clipped_noise import unclipped_mean
from deshake.pair.registration import MAX_ANGLE, Registration, register, registered
from deshake.run import Run
from deshake.signal.luminance import luminance
from deshake.stages.calibration import calibrate, camera_for
from deshake.version import __version__

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.files.kernel_file import CameraFile
    from deshake.formats.encoding import Format
    from deshake.formats.photo import Photo
    from deshake.stages.estimate_options import EstimateOptions

__all__ = [
    "RegistrationResult",
    "checkerboard",
    "find_registration",
    "known_registration",
    "register_file",
    "register_options",
    "registration_name",
    "relative_zoom",
    "search_range",
]

_log = logging.getLogger(__name__)

Image = NDArray[np.float32]

_ZOOMED = 0.05  # relative difference of two focal lengths; with more they are not equal
_SQUARES = 10  # number of squares along the longer side of the preview


@dataclass(frozen=True, eq=False)
class RegistrationResult:
    """A registration, its camera, and notes for the user.

    Parameters
    ----------
    registration : Registration
        The registration.
    camera : CameraFile
        The camera of the registration, and the source of its focal length.
    notes : list of str
        Notes for the user, in plain words.

    """

    registration: Registration
    camera: CameraFile
    notes: list[str]

    def report(self) -> dict[str, Any]:
        """Return the figures of the registration as JSON data."""
        registration = self.registration
        return {
            "theta_degrees": [round(angle, 5) for angle in np.degrees(registration.theta).tolist()],
            "scale": round(registration.scale, 5),
            "confidence": round(registration.confidence, 4),
            "notes": self.notes,
            "focal_px": round(registration.camera.focal_px, 2),
            "camera_source": self.camera.source,
        }


def registration_name(source: Path) -> str:
    """Return the default name of a blurred photo's registration: ``<stem>.registration.npz``."""
    return f"{source.stem}.registration.npz"


def known_registration(file: Path) -> Registration:
    """Return the registration of a file; raises KernelFileError as `read_registration` does."""
    content = read_registration(file)
    return Registration(content.theta, content.scale, content.confidence, content.camera)


def search_range(degrees: float | None) -> float:
    """Return the range of the search for a registration in radians; None: the default."""
    return MAX_ANGLE if degrees is None else math.radians(degrees)


def register_options(options: EstimateOptions) -> dict[str, Any]:
    """Return the options that affect a registration; the provenance has the camera beside them."""
    return {"transfer": options.transfer, "search_angle": options.search_angle}


def find_registration(
    blurred: Photo,
    noisy: Photo,
    options: EstimateOptions,
    *,
    run: Run = Run(),
) -> RegistrationResult:
    """Register a noisy photo to a blurred one.

    Parameters
    ----------
    blurred, noisy : Photo
        The photos.
    options : EstimateOptions
        Options; only the camera and `search_angle` count.
    run : Run, optional
        Threads to use, and who receives the progress.

    Raises
    ------
    PhotoError
        If the photos were taken at different focal lengths.
    CalibrationError, KernelFileError
        If a given camera is absurd or does not fit.
    EstimationError
        If the photos do not show the same scene, or have different proportions.

    """
    camera, notes = camera_for(blurred, options.camera)
    if not options.camera.has_focal_length:
        zoom = relative_zoom(blurred, noisy)
        if zoom is not None:
            raise PhotoError(
                f"taken at {zoom:.2f} times the focal length of {blurred.source}",
                hint="both photos must be taken at one focal length; --focal-35mm MM says that "
                "they were, where the metadata are wrong",
                file=noisy.source,
            )
    straight, other, pinhole = straight_pair(blurred, noisy, camera.camera)
    try:
        registration = register(
            straight.pixels,
            unclipped_mean(other.pixels),
            pinhole,
            max_angle=search_range(options.search_angle),
            run=run,
        )
    except DeshakeError as error:
        error.file = error.file or f"{blurred.source}, {noisy.source}"
        raise
    return RegistrationResult(replace(registration, camera=camera.camera), camera, notes)


def register_file(
    blurred: Path,
    noisy: Path,
    output: Path,
    options: EstimateOptions,
    *,
    preview: Path | None = None,
    overwrite: bool = False,
    overwrite_others: bool = False,
    keep_result: bool = False,
    run: Run = Run(),
) -> RegistrationResult:
    """Register a noisy photo to a blurred one, and write the registration file.

    Parameters
    ----------
    blurred, noisy : Path
        The photos.
    output : Path
        The registration file, or "-" for standard output.
    options : EstimateOptions
        Options; only the camera, `transfer` and `search_angle` count.
    preview : Path, optional
        Path of a checkerboard of both photos. It appears only together with the registration file.
    overwrite, overwrite_others : bool
        Whether an existing registration file, or an existing preview, may be replaced.
    keep_result : bool
        Whether the registration file exists already and is kept; only the preview is written.
    run : Run, optional
        Threads to use, and who receives the progress.

    Raises
    ------
    PhotoError
        If a photo cannot be read.
    PhotoError, CalibrationError, KernelFileError, EstimationError
        For the reasons of `find_registration`.
    OutputError
        If an output cannot be written.

    """
    check_output(output, blurred, noisy, overwrite=overwrite or keep_result)
    if preview is not None:
        check_output(preview, blurred, noisy, output, overwrite=overwrite_others)
    g, f_N = read_pair(blurred, noisy, transfer=options.transfer)
    form = None if preview is None else _preview_format(preview, g)
    match = find_registration(g, f_N, options, run=run)
    registration = match.registration
    for note in match.notes:
        _log.warning("%s: %s", blurred, note)
    content = RegistrationFile(
        registration.theta,
        registration.scale,
        registration.camera,
        registration.confidence,
        _provenance(g, f_N, options, match),
    )
    with joint_outputs(blurred, noisy) as add:
        if preview is not None:
            straight, other, pinhole = straight_pair(g, f_N, registration.camera)
            seams = checkerboard(straight, other, replace(registration, camera=pinhole))
            add(preview, encode_photo(seams, form), overwrite=overwrite_others)
        if not keep_result:
            add(output, registration_bytes(content), overwrite=overwrite)
    return match


def checkerboard(blurred: Photo, noisy: Photo, registration: Registration) -> Photo:
    """Draw a blurred and a registered noisy photo as the squares of a checkerboard.

    The registration is right if edges continue from square to square.

    Parameters
    ----------
    blurred, noisy : Photo
        The photos.
    registration : Registration
        Their registration.

    Returns
    -------
    Photo
        The checkerboard, of the blurred photo's size, 8 bits, without metadata. Pixels outside the
        noisy photo are those of the blurred photo.

    """
    height, width = blurred.shape
    f_N, g = noisy.pixels, blurred.pixels
    if f_N.ndim != g.ndim:
        f_N, g = luminance(f_N), luminance(g)
    f_reg, valid = registered(f_N, registration)
    side = math.ceil(max(height, width) / _SQUARES)
    rows, columns = np.arange(height) // side, np.arange(width) // side
    shown = ((rows[:, None] + columns) % 2 == 1) & (valid > 0)
    f_reg *= np.float32(registration.scale)
    np.copyto(f_reg, g, where=~(shown if g.ndim == 2 else shown[..., None]))
    encoding = Encoding(
        "PNG",
        grey=g.ndim == 2,
        transfer=blurred.encoding.transfer,
        matrix=blurred.encoding.matrix,
    )
    return replace(blurred, pixels=f_reg, alpha=None, encoding=encoding, metadata=Metadata())


def _preview_format(path: Path, photo: Photo) -> Format:
    """Return the format of a preview from its name; PNG for standard output."""
    return "PNG" if str(path) == STREAM else output_format(path, photo.source, photo.encoding)


def relative_zoom(blurred: Photo, noisy: Photo) -> float | None:
    """Return the ratio of the noisy photo's focal length to the blurred one's, if they differ.

    None if the two are equal, or if the metadata of one photo lack the focal length.
    """
    try:
        one, other = (
            calibrate(photo).camera.focal_px / max(photo.shape) for photo in (blurred, noisy)
        )
    except CalibrationError:
        return None
    return other / one if abs(other / one - 1) > _ZOOMED else None


def _provenance(
    blurred: Photo, noisy: Photo, options: EstimateOptions, match: RegistrationResult
) -> dict[str, Any]:
    return {
        "deshake": __version__,
        "command": "register",
        "options": register_options(options),
        "input_sha256": blurred.sha256,
        "noisy_sha256": noisy.sha256,
        "camera": match.camera.source,
        "notes": match.notes,
    }
