"""The kernel of a photo from the photo alone."""

from __future__ import annotations

import logging
import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Final

from deshake.blind.estimate import estimate_kernel
from deshake.errors import DeshakeError
from deshake.files.kernel_file import CameraFile, KernelFile
from deshake.formats.camera_curve import light_before
from deshake.lens.focal_length import ASSUMED
from deshake.lens.straightening import (
    bent_kernel,
    straight_region,
    straightened,
)
from deshake.run import Run
from deshake.signal.luminance import luminance
from deshake.signal.noise import noise_model
from deshake.stages.calibration import ASSUMPTION, assumed_camera, camera_for, focal_35mm
from deshake.stages.estimate_options import EstimateOptions, largest_blur
from deshake.stages.estimate_result import Estimate
from deshake.stages.fitting import check_region
from deshake.version import __version__

if TYPE_CHECKING:
    from deshake.blind.result import BlindEstimate
    from deshake.formats.photo import Photo
    from deshake.stages.camera_choice import CameraChoice


__all__ = [
    "estimate_blind",
    "silent_estimate",
    "warn",
]

_log = logging.getLogger(__name__)

_MID_GREY: Final = 0.18  # linear light, 0..1


def estimate_blind(
    photo: Photo,
    options: EstimateOptions,
    *,
    run: Run = Run(),
) -> Estimate:
    """Estimate the blur kernel of a photo, from its luminance.

    If the focal length is unknown, or with ``focal="auto"``, the estimate by edges begins at a 50
    mm equivalent, and estimates the focal length, too; a note says so. A photo from a lens with
    distortion is straightened first; the kernel's camera is the photo's.

    Raises
    ------
    CalibrationError
        If a given focal length is absurd.
    KernelFileError
        If a given camera does not fit the photo.
    PhotoError
        If the region lies outside the photo.
    EstimationError
        If the photo is too small, too flat, or nearly all clipped.

    """
    estimate = silent_estimate(photo, options, run=run)
    warn(photo, estimate)
    return estimate


def silent_estimate(photo: Photo, options: EstimateOptions, *, run: Run = Run()) -> Estimate:
    """Estimate as `estimate_blind` does, but without warnings of its notes."""
    camera, notes = _first_camera(photo, options.camera)
    any_focal = camera.source == ASSUMED
    check_region(photo, options.region)
    straight, pinhole = straightened(_without_colours(photo), camera.camera)
    grey = straight.pixels
    try:
        blind = estimate_kernel(
            grey,
            pinhole,
            estimator=options.estimator,
            clipped=straight.clipped,
            blur_px=largest_blur(pinhole, options),
            region=straight_region(options.region, camera.camera, pinhole),
            least_confidence=options.least_confidence,
            uniform=options.uniform,
            quick=options.preview,
            any_focal=any_focal,
            before_curve=light_before if photo.may_be_toned else None,
            run=run,
        )
    except DeshakeError as error:
        error.file = error.file or str(photo.source)
        raise
    if blind.zoom != 1:
        camera, notes = _estimated_camera(camera, notes, blind.zoom)
    notes += blind.notes
    provenance = _provenance(photo, options, camera, blind) | {"notes": notes}
    kernel = bent_kernel(blind.kernel, camera.camera, pinhole)
    content = KernelFile(kernel, blind.confidence, provenance)
    slope, floor = noise_model(grey)
    noise = math.sqrt(slope * _MID_GREY + floor)
    return Estimate(content, camera, notes, latent=blind.latent, noise=noise, streaks=blind.streaks)


def warn(photo: Photo, estimate: Estimate) -> None:
    """Warn of the notes of an estimate."""
    for note in estimate.notes:
        _log.warning("%s: %s", photo.source, note)


def _first_camera(photo: Photo, choice: CameraChoice) -> tuple[CameraFile, list[str]]:
    """Return the camera at which an estimate begins, and notes on assumptions."""
    return (assumed_camera(photo), []) if choice.focal == "auto" else camera_for(photo, choice)


def _estimated_camera(
    camera: CameraFile, notes: list[str], zoom: float
) -> tuple[CameraFile, list[str]]:
    """Return the camera with the focal length that was estimated, and what the notes say then."""
    zoomed = camera.camera.zoomed(zoom)
    film = f"{focal_35mm(zoomed):.0f} mm-equivalent"
    suits = f"a {film} suits the photo: --focal-35mm sets another"
    reasons = [note.replace(ASSUMPTION, suits) for note in notes]
    return CameraFile(zoomed, f"estimated with the kernel: {film}"), reasons


def _without_colours(photo: Photo) -> Photo:
    """Reduce the pixels of a photo to their luminance, all that an estimate needs."""
    return replace(photo, pixels=luminance(photo.pixels), frame=None)  # a frame keeps the colours


def _provenance(
    photo: Photo, options: EstimateOptions, camera: CameraFile, blind: BlindEstimate
) -> dict[str, Any]:
    scales = [
        {name: value for name, value in asdict(scale).items() if math.isfinite(value)}
        for scale in blind.scales
    ]
    return {
        "deshake": __version__,
        "command": "estimate-blind",
        "options": options.provenance(),
        "input_sha256": photo.sha256,
        "camera": camera.source,
        "tones": blind.tones,
        "estimated_by": blind.name,
        "scales": scales,
    }
