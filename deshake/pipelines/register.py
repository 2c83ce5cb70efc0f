"""From a blurred and a noisy photo to their registration: what ``register`` runs."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deshake import __version__
from deshake.deconvolution.clipped_noise import unclipped_mean
from deshake.errors import CalibrationError, DeshakeError, PhotoError
from deshake.estimation.registration import MAX_ANGLE, Registration, register, registered
from deshake.io.conversion import output_format
from deshake.io.encoding import Encoding
from deshake.io.files import STREAM, check_output, sha256
from deshake.io.joint_outputs import joint_outputs
from deshake.io.metadata import Metadata
from deshake.io.photo import encode_photo, read_pair
from deshake.io.registration_file import (
    RegistrationFile,
    read_registration,
    registration_bytes,
)
from deshake.pipelines.calibration import calibrate, camera_for
from deshake.pipelines.lens import straight_pair
from deshake.pipelines.stages import EstimateOptions, luminance

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.io.encoding import Format
    from deshake.io.kernel_file import CameraFile
    from deshake.io.photo import Photo

__all__ = [
    "Found",
    "checkerboard",
    "find_registration",
    "known_registration",
    "register_file",
    "registration_name",
    "relative_zoom",
]

_log = logging.getLogger(__name__)

Image = NDArray[np.float32]

_ZOOMED = 0.05  # two focal lengths that differ by more are not one
_SQUARES = 10  # along the longer side of the preview


@dataclass(frozen=True, eq=False)
class Found:
    """A registration, and what the user should know of it.

    Parameters
    ----------
    registration : Registration
        The registration.
    camera : CameraFile
        The camera that was gone by, and where its focal length comes from.
    notes : list of str
        In plain words.

    """

    registration: Registration
    camera: CameraFile
    notes: list[str]

    def report(self) -> dict[str, Any]:
        """Return the figures of the registration as JSON data."""
        found = self.registration
        return {
            "theta_degrees": [round(angle, 5) for angle in np.degrees(found.theta).tolist()],
            "scale": round(found.scale, 5),
            "confidence": round(found.confidence, 4),
            "notes": self.notes,
            "focal_px": round(found.camera.focal_px, 2),
            "camera_source": self.camera.source,
        }


def registration_name(source: Path) -> str:
    """Return the default name of a blurred photo's registration: ``<stem>.registration.npz``."""
    return f"{source.stem}.registration.npz"


def known_registration(file: Path) -> Registration:
    """Return the registration of a file; raises KernelFileError as `read_registration` does."""
    content = read_registration(file)
    return Registration(content.theta, content.scale, content.confidence, content.camera)


def find_registration(
    blurred: Photo,
    noisy: Photo,
    options: EstimateOptions,
    *,
    max_angle: float = MAX_ANGLE,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Found:
    """Register a noisy photo to a blurred one.

    Parameters
    ----------
    blurred, noisy : Photo
        The photos.
    options : EstimateOptions
        Of which the camera counts.
    max_angle : float
        Largest rotation about any axis to look for, in radians.
    threads : int, optional
        Threads to use; by default all processors.
    progress : callable, optional
        Told the fraction done and what is being done.

    Raises
    ------
    PhotoError
        If the photos were taken at different focal lengths.
    CalibrationError, KernelFileError
        If the camera that was given is absurd or does not fit.
    EstimationError
        If the photos do not show the same scene, or have different proportions.

    """
    camera, notes = camera_for(blurred, options)
    if options.camera is None and options.focal_px is None and options.focal_35mm is None:
        zoom = relative_zoom(blurred, noisy)
        if zoom is not None:
            raise PhotoError(
                f"taken at {zoom:.2f} times the focal length of {blurred.source}",
                hint="both photos must be taken at one focal length; --focal-35mm MM says that "
                "they were, where the metadata are wrong",
                file=noisy.source,
            )
    straight, other, seen = straight_pair(blurred, noisy, camera.camera)
    try:
        registration = register(
            straight.pixels,
            unclipped_mean(other.pixels),
            seen,
            max_angle=max_angle,
            progress=progress,
            threads=threads,
        )
    except DeshakeError as error:
        error.file = error.file or f"{blurred.source}, {noisy.source}"
        raise
    return Found(replace(registration, camera=camera.camera), camera, notes)


def register_file(
    blurred: Path,
    noisy: Path,
    output: Path,
    options: EstimateOptions,
    *,
    preview: Path | None = None,
    overwrite: bool = False,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Found:
    """Register a noisy photo to a blurred one, and write the registration file.

    Parameters
    ----------
    blurred, noisy : Path
        The photos.
    output : Path
        The registration file, or "-" for standard output.
    options : EstimateOptions
        Of which the camera, `transfer` and `max_angle` count.
    preview : Path, optional
        Where a checkerboard of both photos goes, which is kept only together with the file.
    overwrite : bool
        Whether existing outputs may be replaced.
    threads : int, optional
        Threads to use; by default all processors.
    progress : callable, optional
        Told the fraction done and what is being done.

    Raises
    ------
    PhotoError
        If a photo cannot be read, or for the reasons of `find_registration`.
    CalibrationError, KernelFileError, EstimationError
        For those reasons.
    OutputError
        If an output cannot be written.

    """
    check_output(output, blurred, noisy, overwrite=overwrite)
    if preview is not None:
        check_output(preview, blurred, noisy, output, overwrite=overwrite)
    g, f_N = read_pair(blurred, noisy, transfer=options.transfer)
    form = None if preview is None else _preview_format(preview, g)
    angle = MAX_ANGLE if options.max_angle is None else math.radians(options.max_angle)
    found = find_registration(g, f_N, options, max_angle=angle, threads=threads, progress=progress)
    registration = found.registration
    for note in found.notes:
        _log.warning("%s: %s", blurred, note)
    content = RegistrationFile(
        registration.theta,
        registration.scale,
        registration.camera,
        registration.confidence,
        _provenance(g, f_N, options, found),
    )
    with joint_outputs(blurred, noisy) as add:
        if preview is not None:
            straight, other, seen = straight_pair(g, f_N, registration.camera)
            seams = checkerboard(straight, other, replace(registration, camera=seen))
            data = encode_photo(seams, form)
            add(preview, data, overwrite=overwrite)
        add(output, registration_bytes(content), overwrite=overwrite)
    return found


def checkerboard(blurred: Photo, noisy: Photo, registration: Registration) -> Photo:
    """Lay a blurred and a registered noisy photo out as the squares of a checkerboard.

    Edges that run on from square to square show that the registration is right.

    Parameters
    ----------
    blurred, noisy : Photo
        The photos.
    registration : Registration
        Their registration.

    Returns
    -------
    Photo
        Of the blurred photo's size, 8 bits, without metadata; all of it is the blurred photo where
        the noisy one sees nothing.

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
    """Return the format of a preview: by its name, PNG for standard output."""
    return "PNG" if str(path) == STREAM else output_format(path, photo)


def relative_zoom(blurred: Photo, noisy: Photo) -> float | None:
    """Return how many times the focal length of one photo the other's is, if they are not one.

    None where they are, or where the metadata of one do not tell.
    """
    try:
        one, other = (
            calibrate(photo).camera.focal_px / max(photo.shape) for photo in (blurred, noisy)
        )
    except CalibrationError:
        return None
    return other / one if abs(other / one - 1) > _ZOOMED else None


def _provenance(
    blurred: Photo, noisy: Photo, options: EstimateOptions, found: Found
) -> dict[str, Any]:
    return {
        "deshake": __version__,
        "command": "register",
        "options": {"transfer": options.transfer, "max_angle": options.max_angle},
        "input_sha256": sha256(blurred.source),
        "noisy_sha256": sha256(noisy.source),
        "camera": found.camera.source,
        "notes": found.notes,
    }
