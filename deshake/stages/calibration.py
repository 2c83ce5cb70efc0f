"""The camera of a photo: its focal length in pixels and, on request, its lens distortion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from deshake.errors import CalibrationError
from deshake.files.disk import check_output
from deshake.files.kernel_file import CameraFile, write_camera
from deshake.formats.photo import read_photo
from deshake.geometry.camera import Camera
from deshake.lens.focal_length import FULL_FRAME_DIAGONAL, assumed_focal_length, focal_length
from deshake.lens.lens_profiles import find_profile
from deshake.lens.straightening import check_unstraightened
from deshake.stages.fitting import fitting_camera

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.formats.photo import Photo
    from deshake.stages.camera_choice import CameraChoice

__all__ = [
    "ASSUMPTION",
    "Calibration",
    "assumed_camera",
    "calibrate",
    "calibrate_file",
    "camera_for",
    "focal_35mm",
]

ASSUMPTION: Final = "a 50 mm-equivalent is assumed: --focal-35mm sets another"
"""Last part of the note on an assumed focal length."""


def focal_35mm(camera: Camera) -> float:
    """Return the 35 mm equivalent of a focal length in mm, by the diagonal of the photo."""
    return camera.focal_px * FULL_FRAME_DIAGONAL / math.hypot(*camera.shape)


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera and its confidence.

    Parameters
    ----------
    camera : Camera
        The camera of the upright photo, its principal point in the middle.
    source : str
        The option or tag that the focal length comes from.
    confidence : float
        Chance that the focal length is right to within 5 %, as judged in `lens.focal_length`.
    notes : list of str
        Notes for the user.
    considered : list of str
        All sources that were considered, for a verbose log.
    lens : str
        Name of the lens whose distortion the camera has; empty: none.

    """

    camera: Camera
    source: str
    confidence: float
    notes: list[str]
    considered: list[str]
    lens: str = ""

    @property
    def content(self) -> CameraFile:
        """The content of a camera file."""
        lens = f"; lens {self.lens} (lensfun)" if self.lens else ""
        return CameraFile(self.camera, self.source + lens)

    @property
    def focal_35mm(self) -> float:
        """The 35 mm equivalent, by the diagonal of the photo."""
        return focal_35mm(self.camera)

    def report(self) -> dict[str, Any]:
        """Return the figures as JSON data."""
        figures = {
            "focal_px": round(self.camera.focal_px, 3),
            "focal_35mm": round(self.focal_35mm, 3),
            "source": self.source,
            "confidence": round(self.confidence, 3),
            "notes": self.notes,
            "width": self.camera.width,
            "height": self.camera.height,
        }
        if self.lens:
            figures |= {"lens": self.lens, "distortion": self.camera.distortion.tolist()}
        return figures


def calibrate(
    photo: Photo,
    *,
    focal_px: float | None = None,
    focal_35mm: float | None = None,
    lens: bool = False,
    lens_model: str | None = None,
) -> Calibration:
    """Determine the camera of an upright photo, with the principal point in the middle.

    Parameters
    ----------
    photo : Photo
        The photo.
    focal_px, focal_35mm : float, optional, keyword-only
        Its focal length; by default from the metadata.
    lens : bool, keyword-only
        Whether to look up the distortion of its lens in lensfun's database.
    lens_model : str, optional, keyword-only
        Name of the lens in that database; by default from EXIF.

    Raises
    ------
    CalibrationError
        If neither the options nor the metadata have the focal length, or the database lacks the
        lens.

    """
    try:
        focal = focal_length(photo.metadata, *photo.shape, focal_px=focal_px, focal_35mm=focal_35mm)
        camera = Camera.from_focal(focal.pixels, *photo.shape)
        notes, considered = list(focal.notes), list(focal.considered)
        name = ""
        if lens or lens_model is not None:
            profile = find_profile(
                photo.metadata.tags(), focal.pixels, focal.frame or photo.shape, lens=lens_model
            )
            camera, name = camera.with_lens(profile.distortion), profile.lens
            considered.append(
                f"lens {name} at {profile.focal_mm:g} mm, within {profile.error_px:.2f} pixels"
            )
    except CalibrationError as error:
        error.file = error.file or str(photo.source)
        raise
    return Calibration(camera, focal.source, focal.confidence, notes, considered, name)


def calibrate_file(
    source: Path,
    output: Path | None,
    *,
    focal_px: float | None = None,
    focal_35mm: float | None = None,
    lens: bool = False,
    lens_model: str | None = None,
    overwrite: bool = False,
) -> Calibration:
    """Determine the camera of a photo, and write its camera file if `output` is given.

    Raises
    ------
    PhotoError
        If the photo cannot be read.
    CalibrationError
        If the focal length is unknown, the database lacks the lens, or the photo is straightened
        already.
    OutputError
        If the camera file cannot be written.

    """
    if output is not None:
        check_output(output, source, overwrite=overwrite)
    photo = read_photo(source)
    if lens or lens_model is not None:
        check_unstraightened(photo)
    calibration = calibrate(
        photo,
        focal_px=focal_px,
        focal_35mm=focal_35mm,
        lens=lens,
        lens_model=lens_model,
    )
    if output is not None:
        write_camera(output, calibration.content, overwrite=overwrite, made_from=[source])
    return calibration


def camera_for(photo: Photo, choice: CameraChoice) -> tuple[CameraFile, list[str]]:
    """Return the camera of a photo, and notes on assumptions."""
    if choice.file is not None:
        return fitting_camera(choice.file, photo), []
    try:
        calibration = calibrate(
            photo,
            focal_px=choice.focal_px,
            focal_35mm=choice.focal_35mm,
            lens=choice.looks_up_lens,
            lens_model=choice.lens_model,
        )
    except CalibrationError as error:
        if choice.has_focal_length or choice.looks_up_lens:
            raise
        return assumed_camera(photo), [f"{error.message}; {ASSUMPTION}"]
    return calibration.content, calibration.notes


def assumed_camera(photo: Photo) -> CameraFile:
    """Return the camera of a photo whose focal length no one knows."""
    assumed = assumed_focal_length(*photo.shape)
    return CameraFile(Camera.from_focal(assumed.pixels, *photo.shape), assumed.source)
