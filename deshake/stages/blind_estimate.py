"""The kernel of a photo from the photo alone."""

from __future__ import annotations

import logging
import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Final

from deshake.blind.estimate import estimate_kernel
from deshake.errors import DeshakeError
from deshake.files.kernel_file import KernelFile
from deshake.lens.straightening import (
    bent_kernel,
    straight_region,
    straightened,
)
from deshake.run import Run
from deshake.signal.luminance import luminance
from deshake.signal.noise import noise_model
from deshake.stages.calibration import camera_for
from deshake.stages.estimate_options import EstimateOptions, largest_blur
from deshake.stages.estimate_result import Estimate
from deshake.stages.fitting import check_region
from deshake.version import __version__

if TYPE_CHECKING:
    from deshake.blind.result import BlindEstimate
    from deshake.files.kernel_file import CameraFile
    from deshake.formats.photo import Photo


__all__ = [
    "FOCAL_LENGTHS",
    "estimate_blind",
    "silent_estimate",
    "warn",
]

_log = logging.getLogger(__name__)

FOCAL_LENGTHS: Final = (24.0, 35.0, 50.0, 70.0)
"""Focal lengths in mm (35 mm equivalent) that an estimate of kernel and focal length tries."""

_MID_GREY: Final = 0.18  # linear light, 0..1


def estimate_blind(
    photo: Photo,
    options: EstimateOptions,
    *,
    run: Run = Run(),
) -> Estimate:
    """Estimate the blur kernel of a photo, from its luminance.

    If the focal length is unknown, a 50 mm equivalent is assumed, and a note says so. A focal
    length that is too long costs little; one that is too short distorts the rotations. A photo
    from a lens with distortion is straightened first; the kernel's camera is the photo's. With
    ``focal="auto"`` the kernel is estimated at each of `FOCAL_LENGTHS`, and the kernel with the
    highest confidence is kept.

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
    if options.camera.focal == "auto" and not options.uniform:
        return _at_best_focal_length(photo, options, run)
    return _estimate(photo, options, run)


def warn(photo: Photo, estimate: Estimate) -> None:
    """Warn of the notes of an estimate."""
    for note in estimate.notes:
        _log.warning("%s: %s", photo.source, note)


def _at_best_focal_length(photo: Photo, options: EstimateOptions, run: Run) -> Estimate:
    """Estimate at several focal lengths; the confidence rises with the judge's score."""
    best: Estimate | None = None
    count = len(FOCAL_LENGTHS)
    for number, film in enumerate(FOCAL_LENGTHS):
        partial = run.part(number / count, (number + 1) / count)
        at = replace(options, camera=replace(options.camera, focal=None, focal_35mm=film))
        estimate = _estimate(photo, at, partial)
        _log.info("%s: %g mm: confidence %.6f", photo.source, film, estimate.content.confidence)
        if best is None or estimate.content.confidence > best.content.confidence:
            source = f"--focal auto, {film:g} mm-equivalent"
            content = replace(
                estimate.content,
                provenance=estimate.content.provenance
                | {"options": options.provenance(), "camera": source},
            )
            camera = replace(estimate.camera, source=source)
            best = replace(estimate, content=content, camera=camera)
    if best is None:
        raise ValueError("there is no focal length to try")
    return best


def _estimate(photo: Photo, options: EstimateOptions, run: Run) -> Estimate:
    """Estimate at one focal length."""
    camera, notes = camera_for(photo, options.camera)
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
            uniform=options.uniform,
            quick=options.preview,
            run=run,
        )
    except DeshakeError as error:
        error.file = error.file or str(photo.source)
        raise
    notes += blind.notes
    provenance = _provenance(photo, options, camera, blind) | {"notes": notes}
    kernel = bent_kernel(blind.kernel, camera.camera, pinhole)
    content = KernelFile(kernel, blind.confidence, provenance)
    slope, floor = noise_model(grey)
    noise = math.sqrt(slope * _MID_GREY + floor)
    return Estimate(content, camera, notes, latent=blind.latent, noise=noise)


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
        "estimated_by": blind.name,
        "scales": scales,
    }
