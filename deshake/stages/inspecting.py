"""Report what a file is: the work of ``inspect``.

For a photo, the report says whether it is sharp, shaken, soft or out of focus. For a kernel, camera
or registration file, and for a photo that deshake made, it says how the file was made.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from deshake.blind.blur_kind import blur_kind
from deshake.blind.bounds import check_size
from deshake.errors import DeshakeError
from deshake.files.artifact import is_artifact, read_artifact
from deshake.files.kernel_file import CameraFile, KernelFile
from deshake.files.registration_file import RegistrationFile
from deshake.formats.photo import read_photo
from deshake.metadata.provenance import carried_provenance
from deshake.signal.luminance import luminance
from deshake.signal.noise import noise_model
from deshake.signal.pyramid import Pyramid
from deshake.stages.calibration import camera_for, focal_35mm
from deshake.stages.camera_choice import CameraChoice

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from deshake.blind.blur_kind import BlurKind
    from deshake.formats.photo import Photo
    from deshake.formats.transfer import TransferName
    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel

__all__ = ["inspect_file", "photo_blur"]

_MID_GREY: Final = 0.18  # linear light, 0..1
_FAINT: Final = 0.01  # share of the largest weight; smaller weights do not count for the angles


def inspect_file(path: Path) -> dict[str, Any]:
    """Report what a file is, as JSON data.

    Returns
    -------
    dict
        ``kind`` is "photo", "kernel", "camera" or "registration"; the other figures are those of
        its kind. A photo that deshake made, and a kernel or registration file, have their
        ``provenance``.

    Raises
    ------
    PhotoError, EstimationError
        If it is a photo that cannot be read, or one without texture.
    KernelFileError
        If it is a damaged file of deshake.

    """
    if not is_artifact(path):
        return _photo(path)
    match read_artifact(path):
        case KernelFile() as content:
            return _kernel(content)
        case RegistrationFile() as content:
            return _registration(content)
        case CameraFile() as content:
            return {"kind": "camera", "source": content.source} | _camera(content.camera)


def photo_blur(path: Path, *, transfer: TransferName | None = None) -> BlurKind:
    """Detect what blurs a photo; this takes a second or two.

    Raises
    ------
    PhotoError, EstimationError
        If it cannot be read, or has no texture.

    """
    return _blur(read_photo(path, transfer=transfer, luma=True, reduction=luminance))


def _photo(path: Path) -> dict[str, Any]:
    """Return the figures of a photo."""
    photo = read_photo(path, luma=True, reduction=luminance)
    blur = _blur(photo)
    camera, _ = camera_for(photo, CameraChoice())
    slope, floor = noise_model(photo.pixels)
    figures: dict[str, Any] = {"kind": "photo"} | blur.report()
    figures["noise"] = round(math.sqrt(slope * _MID_GREY + floor), 5)
    figures |= {"format": photo.encoding.format} | _camera(camera.camera)
    figures["focal_source"] = camera.source
    provenance = carried_provenance(photo.metadata)
    return figures if provenance is None else figures | {"provenance": provenance}


def _blur(photo: Photo) -> BlurKind:
    """Detect what blurs a photo that was reduced to its luminance."""
    camera = camera_for(photo, CameraChoice())[0].camera
    try:
        check_size(*photo.shape, 1.0)
        return blur_kind(Pyramid(photo.pixels, camera, photo.clipped))
    except DeshakeError as error:
        error.file = error.file or str(photo.source)
        raise


def _camera(camera: Camera) -> dict[str, Any]:
    """Return the figures of a camera."""
    figures = {
        "width": camera.width,
        "height": camera.height,
        "focal_px": round(camera.focal_px, 2),
        "focal_35mm": round(focal_35mm(camera), 2),
    }
    if not camera.is_pinhole:
        figures["distortion"] = camera.distortion.tolist()
    return figures


def _kernel(content: KernelFile) -> dict[str, Any]:
    """Return the figures of a kernel file."""
    kernel = content.kernel
    figures = {
        "kind": "kernel",
        "model": _model(kernel),
        "extent_px": round(kernel.extent_px(), 2),
        "angles_deg": _degrees(np.ptp(kernel.above(_FAINT).theta, axis=0)),
        "rotations": len(kernel.weights),
        "confidence": round(content.confidence, 4),
    }
    return figures | _camera(kernel.camera) | {"provenance": content.provenance}


def _model(kernel: RotationKernel) -> str:
    """Name the model of a kernel: of no motion, of shifts, or of rotations."""
    if kernel.is_still:
        return "still"
    return "uniform" if kernel.camera.is_uniform else "rotations"


def _registration(content: RegistrationFile) -> dict[str, Any]:
    """Return the figures of a registration file."""
    figures = {
        "kind": "registration",
        "rotation_deg": _degrees(content.theta),
        "scale": round(content.scale, 5),
        "confidence": round(content.confidence, 4),
    }
    return figures | _camera(content.camera) | {"provenance": content.provenance}


def _degrees(angles: NDArray[np.float64]) -> list[float]:
    """Return angles about X, Y and Z in degrees."""
    return [round(math.degrees(angle), 4) for angle in angles]
