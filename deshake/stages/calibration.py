"""The camera of a photo: its focal length in pixels and, if asked for, its lens's distortion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

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

__all__ = ["Calibration", "calibrate", "calibrate_file", "camera_for"]


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera and how far it is to be trusted.

    Parameters
    ----------
    camera : Camera
        The camera of the upright photo, its principal point in the middle.
    source : str
        Which option or tag gave the focal length.
    confidence : float
        How likely the focal length is right to within 5 %: a judgement, see `lens.focal_length`.
    notes : list of str
        What the user should know.
    considered : list of str
        All that was looked at, for those who ask.
    lens : str
        The lens whose distortion the camera has; empty: none.

    """

    camera: Camera
    source: str
    confidence: float
    notes: list[str]
    considered: list[str]
    lens: str = ""

    @property
    def content(self) -> CameraFile:
        """What goes into a camera file."""
        lens = f"; lens {self.lens} (lensfun)" if self.lens else ""
        return CameraFile(self.camera, self.source + lens)

    @property
    def focal_35mm(self) -> float:
        """The 35 mm equivalent, by the diagonal of the photo."""
        return self.camera.focal_px * FULL_FRAME_DIAGONAL / math.hypot(*self.camera.shape)

    def report(self) -> dict[str, Any]:
        """Return the figures as JSON data."""
        found = {
            "focal_px": round(self.camera.focal_px, 3),
            "focal_35mm": round(self.focal_35mm, 3),
            "source": self.source,
            "confidence": round(self.confidence, 3),
            "notes": self.notes,
            "width": self.camera.width,
            "height": self.camera.height,
        }
        if self.lens:
            found |= {"lens": self.lens, "distortion": self.camera.distortion.tolist()}
        return found


def calibrate(
    photo: Photo,
    *,
    focal_px: float | None = None,
    focal_35mm: float | None = None,
    lens: bool = False,
    lens_model: str | None = None,
) -> Calibration:
    """Find the camera of an upright photo: its focal length, the principal point in the middle.

    Parameters
    ----------
    photo : Photo
        The photo.
    focal_px, focal_35mm : float, optional, keyword-only
        Its focal length, instead of what its metadata tell.
    lens : bool, keyword-only
        Whether the distortion of its lens is looked up in lensfun's database.
    lens_model : str, optional, keyword-only
        The lens's name in it; by default by EXIF.

    Raises
    ------
    CalibrationError
        If neither the options nor the metadata tell the focal length, or the lens is not found.

    """
    try:
        found = focal_length(photo.metadata, *photo.shape, focal_px=focal_px, focal_35mm=focal_35mm)
        camera = Camera.from_focal(found.pixels, *photo.shape)
        notes, considered = list(found.notes), list(found.considered)
        name = ""
        if lens or lens_model is not None:
            profile = find_profile(
                photo.metadata.tags(), found.pixels, found.frame or photo.shape, lens=lens_model
            )
            camera, name = camera.with_lens(profile.distortion), profile.lens
            considered.append(
                f"lens {name} at {profile.focal_mm:g} mm, met to {profile.error_px:.2f} pixels"
            )
    except CalibrationError as error:
        error.file = error.file or str(photo.source)
        raise
    return Calibration(camera, found.source, found.confidence, notes, considered, name)


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
    """Find the camera of a photo, and write its camera file if `output` is given.

    Raises
    ------
    PhotoError
        If the photo cannot be read.
    CalibrationError
        If nothing tells the focal length, or the lens is not found or was undone already.
    OutputError
        If the camera file cannot be written.

    """
    if output is not None:
        check_output(output, source, overwrite=overwrite)
    photo = read_photo(source)
    if lens or lens_model is not None:
        check_unstraightened(photo)
    found = calibrate(
        photo,
        focal_px=focal_px,
        focal_35mm=focal_35mm,
        lens=lens,
        lens_model=lens_model,
    )
    if output is not None:
        write_camera(output, found.content, overwrite=overwrite, made_from=[source])
    return found


def camera_for(photo: Photo, choice: CameraChoice) -> tuple[CameraFile, list[str]]:
    """Return the camera of a photo, and notes on what is only assumed."""
    if choice.file is not None:
        return fitting_camera(choice.file, photo), []
    try:
        found = calibrate(
            photo,
            focal_px=choice.focal_px,
            focal_35mm=choice.focal_35mm,
            lens=choice.looks_up_lens,
            lens_model=choice.lens_model,
        )
    except CalibrationError as error:
        if choice.has_focal_length or choice.looks_up_lens:
            raise
        assumed = assumed_focal_length(*photo.shape)
        note = f"{error.message}; a 50 mm-equivalent is assumed (--focal-35mm MM says otherwise)"
        return CameraFile(Camera.from_focal(assumed.pixels, *photo.shape), assumed.source), [note]
    return found.content, found.notes
