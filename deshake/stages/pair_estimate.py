"""The kernel of a blurred photo, estimated with a noisy photo of the same scene, Sec. 6.

The noisy photo is registered to the blurred one first, unless a registration is given. If the
kernel explains the blurred photo badly, the tones of the two photos are matched
(`registered_pair`), and the kernel that explains more is kept. If even this kernel explains too
little, the result is the kernel of a still camera, which leaves the photo unchanged.
"""

from __future__ import annotations

import contextlib
import logging
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Final

from deshake.blind.trust import two_digits
from deshake.errors import DeshakeError, EstimationError
from deshake.files.kernel_file import CameraFile, KernelFile
from deshake.geometry.kernel import RotationKernel
from deshake.lens.straightening import bent_kernel, straight_pair
from deshake.pair.clipped_noise import unclipped_mean
from deshake.pair.registered_pair import RegisteredPair
from deshake.pair.registration import registered
from deshake.run import Run
from deshake.stages.estimate_options import largest_blur
from deshake.stages.estimate_result import TRUSTED, Estimate
from deshake.stages.fitting import check_registration
from deshake.stages.registering import find_registration, relative_zoom
from deshake.version import __version__

if TYPE_CHECKING:
    from deshake.formats.photo import Photo
    from deshake.pair.kernel_estimate import PairEstimate
    from deshake.pair.registration import Registration
    from deshake.stages.estimate_options import EstimateOptions


__all__ = ["estimate_pair"]

_log = logging.getLogger(__name__)

_REGISTERED: Final = 0.3  # share of the time for the registration
_UNEXPLAINED: Final = 0.01  # unexplained share of the edges; with more, tone curves are tried


def estimate_pair(
    blurred: Photo,
    noisy: Photo,
    options: EstimateOptions,
    *,
    registration: Registration | None = None,
    run: Run = Run(),
) -> Estimate:
    """Estimate the blur kernel of a blurred photo with a noisy photo of the same scene.

    Parameters
    ----------
    blurred, noisy : Photo
        The pair.
    options : EstimateOptions
        Options of the estimate; region and estimator are ignored.
    registration : Registration, optional
        Registration of the two photos, with its camera. By default they are registered, with the
        camera from the options or from the blurred photo.
    run : Run, optional
        Threads to use, and who receives the progress.

    Raises
    ------
    PhotoError, CalibrationError
        For the reasons of `find_registration`.
    KernelFileError
        If a given camera or registration does not fit the photo.
    EstimationError
        If the photos do not show the same scene, or are too small, too flat, or nearly all clipped.

    """
    notes: list[str] = []
    start = 0.0
    if registration is None:
        first = find_registration(blurred, noisy, options, run=run.part(0, _REGISTERED))
        registration, camera, notes = first.registration, first.camera, list(first.notes)
        start = _REGISTERED
    else:
        camera = CameraFile(registration.camera, "the registration")
        options = replace(options, search_angle=None)  # there is no search
        check_registration(registration.camera, blurred)
        zoom = relative_zoom(blurred, noisy)
        if zoom is not None:
            notes.append(
                f"by the metadata, the noisy photo has {zoom:.2f} times the focal length of the "
                "blurred one"
            )
    half = (start + 1) / 2
    straight, other, pinhole = straight_pair(blurred, noisy, registration.camera)
    aligned = replace(registration, camera=pinhole)
    linear = straight.is_sensors and other.is_sensors
    try:
        resampled = registered(unclipped_mean(other.pixels), aligned)
        pair = RegisteredPair(straight, other, aligned, *resampled)
        common: dict[str, Any] = {
            "uniform": options.uniform,
            "blur_size": largest_blur(pinhole, options),
        }
        fit = pair.kernel(**common, run=run.part(start, half))
        curved = False
        if fit.unexplained > _UNEXPLAINED and not linear:
            with contextlib.suppress(EstimationError):  # without tone curves the one factor is kept
                second = pair.on_curves().kernel(**common, run=run.part(half, 1))
                curved = second.unexplained < fit.unexplained
                fit = second if curved else fit
    except DeshakeError as error:
        error.file = error.file or str(blurred.source)
        raise
    scale = fit.scale
    if curved:
        scale *= registration.scale
        notes.append("the two photos were developed with different tone curves, which were matched")
    notes += fit.notes
    kernel = fit.kernel
    least = TRUSTED if options.least_confidence is None else options.least_confidence
    if fit.confidence < least:
        notes.append(
            "the two photos agree too little to find the shake (confidence "
            f"{two_digits(fit.confidence)}): the photo is left as it is; try without the noisy "
            "photo"
        )
        kernel = RotationKernel.delta(kernel.camera)
    run.report(1.0, "kernel estimated")
    for note in notes:
        _log.warning("%s: %s", blurred.source, note)
    provenance = _provenance((blurred, noisy), options, registration, fit)
    provenance |= {"camera": camera.source, "tone_curves": curved, "notes": notes}
    kernel = bent_kernel(kernel, registration.camera, pinhole)
    content = KernelFile(kernel, fit.confidence, provenance)
    return Estimate(content, camera, notes, registration=registration, scale=scale)


def _provenance(
    pair: tuple[Photo, Photo],
    options: EstimateOptions,
    registration: Registration,
    fit: PairEstimate,
) -> dict[str, Any]:
    """Return the provenance of a kernel, without its camera."""
    return {
        "deshake": __version__,
        "command": "estimate-pair",
        "options": options.provenance(pair=True),
        "input_sha256": pair[0].sha256,
        "noisy_sha256": pair[1].sha256,
        "registration": registration.report(),
        "scale": fit.scale,
        "explained": fit.explained,
        "unexplained": fit.unexplained,
        "scales": [asdict(scale) for scale in fit.scales],
    }
