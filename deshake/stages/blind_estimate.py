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
from deshake.signal.luminance import luminance
from deshake.signal.noise import noise_model
from deshake.stages.calibration import camera_for
from deshake.stages.estimate_options import EstimateOptions, largest_blur
from deshake.stages.estimate_result import Estimate
from deshake.stages.fitting import check_region
from deshake.stages.progress import part
from deshake.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.blind.result import BlindEstimate
    from deshake.files.kernel_file import CameraFile
    from deshake.formats.photo import Photo

    Progress = Callable[[float, str], None]

__all__ = [
    "FOCAL_LENGTHS",
    "estimate_blind",
]

_log = logging.getLogger(__name__)

FOCAL_LENGTHS: Final = (24.0, 35.0, 50.0, 70.0)
"""35 mm equivalents that are tried where the focal length is to be found with the kernel."""

_MID_GREY: Final = 0.18


def estimate_blind(
    photo: Photo,
    options: EstimateOptions,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Estimate the blur kernel of a photo, from its luminance.

    A focal length that nothing tells is assumed to be 50 mm-equivalent, with a note that says so:
    one too long costs little, one too short bends the rotations. A photo through a lens that bends
    is straightened first; the kernel's camera is the photo's. Where the focal length is to be
    found, the kernel is estimated at each of `FOCAL_LENGTHS`, and the one kept that the judge finds
    best.

    Raises
    ------
    CalibrationError
        If a focal length that was given is absurd.
    KernelFileError
        If the camera that was given does not fit the photo.
    PhotoError
        If the region lies outside the photo.
    EstimationError
        If the photo is too small, too flat or too much clipped.

    """
    if options.camera.focal == "auto" and not options.uniform:
        found = _at_best_focal_length(photo, options, threads, progress)
    else:
        found = _estimate(photo, options, threads, progress)
    for note in found.notes:
        _log.warning("%s: %s", photo.source, note)
    return found


def _at_best_focal_length(
    photo: Photo, options: EstimateOptions, threads: int | None, progress: Progress | None
) -> Estimate:
    """Estimate at several focal lengths; the confidence rises with the judge's score."""
    best: Estimate | None = None
    count = len(FOCAL_LENGTHS)
    for number, film in enumerate(FOCAL_LENGTHS):
        told = part(progress, number / count, (number + 1) / count)
        at = replace(options, camera=replace(options.camera, focal=None, focal_35mm=film))
        found = _estimate(photo, at, threads, told)
        _log.info("%s: %g mm: confidence %.6f", photo.source, film, found.content.confidence)
        if best is None or found.content.confidence > best.content.confidence:
            source = f"--focal auto, {film:g} mm-equivalent"
            content = replace(
                found.content,
                provenance=found.content.provenance
                | {"options": options.provenance(), "camera": source},
            )
            camera = replace(found.camera, source=source)
            best = replace(found, content=content, camera=camera)
    if best is None:
        raise ValueError("there is no focal length to try")
    return best


def _estimate(
    photo: Photo, options: EstimateOptions, threads: int | None, progress: Progress | None
) -> Estimate:
    """Estimate at one focal length."""
    camera, notes = camera_for(photo, options.camera)
    check_region(photo, options.region)
    straight, seen = straightened(photo, camera.camera)
    grey = luminance(straight.pixels)
    try:
        found = estimate_kernel(
            grey,
            seen,
            estimator=options.estimator,
            clipped=straight.clipped,
            blur_px=largest_blur(seen, options),
            region=straight_region(options.region, camera.camera, seen),
            uniform=options.uniform,
            quick=options.preview,
            threads=threads,
            progress=progress,
        )
    except DeshakeError as error:
        error.file = error.file or str(photo.source)
        raise
    notes += found.notes
    provenance = _provenance(photo, options, camera, found) | {"notes": notes}
    kernel = bent_kernel(found.kernel, camera.camera, seen)
    content = KernelFile(kernel, found.confidence, provenance)
    slope, floor = noise_model(grey)
    noise = math.sqrt(slope * _MID_GREY + floor)
    return Estimate(content, camera, notes, latent=found.latent, noise=noise)


def _provenance(
    photo: Photo, options: EstimateOptions, camera: CameraFile, found: BlindEstimate
) -> dict[str, Any]:
    scales = [
        {name: value for name, value in asdict(scale).items() if math.isfinite(value)}
        for scale in found.scales
    ]
    return {
        "deshake": __version__,
        "command": "estimate-blind",
        "options": options.provenance(),
        "input_sha256": photo.sha256,
        "camera": camera.source,
        "estimated_by": found.name,
        "scales": scales,
    }
