"""The stages for a blurred and a noisy photo of one scene: to the blur kernel, Sec. 6.

The noisy photo is registered to the blurred one, unless that was done before. Where the kernel then
explains the blurred photo badly, the two photos' tones are matched (`registered_pair`), and the
kernel is kept that explains it better. One that explains too little is not given out: there the
kernel is that of a camera that stood still, with which the photo stays as it is.
"""

from __future__ import annotations

import contextlib
import logging
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from deshake import __version__
from deshake.deconvolution.clipped_noise import unclipped_mean
from deshake.errors import DeshakeError, EstimationError
from deshake.estimation.registration import registered
from deshake.geometry.kernel import RotationKernel
from deshake.io.files import check_output, sha256
from deshake.io.kernel_file import CameraFile, KernelFile, write_kernel
from deshake.io.photo import read_pair
from deshake.pipelines.fitting import check_registration
from deshake.pipelines.lens import bent_kernel, straight_pair
from deshake.pipelines.progress import part
from deshake.pipelines.register import find_registration, known_registration, relative_zoom
from deshake.pipelines.registered_pair import RegisteredPair

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.estimation.pair import PairEstimate
    from deshake.estimation.registration import Registration
    from deshake.io.photo import Photo
    from deshake.pipelines.stages import EstimateOptions

    Progress = Callable[[float, str], None]

__all__ = ["PairKernel", "estimate_pair", "estimate_pair_file"]

_log = logging.getLogger(__name__)

_REGISTERED: Final = 0.3  # of the time
_ALL_BUT: Final = 0.01  # of the edges, left unexplained, above which tone curves are tried
_TRUSTED: Final = 0.5  # confidence below which the photo is left as it is


@dataclass(frozen=True, eq=False)
class PairKernel:
    """A kernel as it goes to its file, and what the user should know of it.

    Parameters
    ----------
    content : KernelFile
        The kernel with its confidence and provenance, in the frame of the registered noisy photo.
    camera : CameraFile
        The camera that was gone by, and where its focal length comes from.
    registration : Registration
        How the noisy photo lies to the blurred one.
    scale : float
        The photometric factor, fitted together with the kernel.
    notes : list of str
        In plain words.

    """

    content: KernelFile
    camera: CameraFile
    registration: Registration
    scale: float
    notes: list[str]

    @property
    def trusted(self) -> bool:
        """Whether the photo is deblurred with it; else the kernel is that of a still camera."""
        return self.content.confidence >= _TRUSTED

    def report(self) -> dict[str, Any]:
        """Return the figures of the estimate as JSON data."""
        kernel = self.content.kernel
        return {
            "rotations": len(kernel.weights),
            "extent_px": round(kernel.extent_px(), 2),
            "confidence": round(self.content.confidence, 4),
            "trusted": self.trusted,
            "scale": round(self.scale, 5),
            "registration_confidence": round(self.registration.confidence, 4),
            "notes": self.notes,
            "focal_px": round(self.camera.camera.focal_px, 2),
            "camera_source": self.camera.source,
        }


def estimate_pair(
    blurred: Photo,
    noisy: Photo,
    options: EstimateOptions,
    *,
    registration: Registration | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> PairKernel:
    """Estimate the blur kernel of a photo with the help of a noisy one.

    Parameters
    ----------
    blurred, noisy : Photo
        The pair.
    options : EstimateOptions
        What to go by; region and estimator do not count.
    registration : Registration, optional
        How the noisy photo lies to the blurred one, with the camera to go by. By default it is
        found, with the camera that the options or the blurred photo tell.
    threads : int, optional
        Threads to use; by default all processors.
    progress : callable, optional
        Told the fraction done and what is being done.

    Raises
    ------
    PhotoError, CalibrationError
        For the reasons of `find_registration`.
    KernelFileError
        If the camera or the registration that was given does not fit the photo.
    EstimationError
        If the photos do not show the same scene, or are too small, too flat or too much clipped.

    """
    notes: list[str] = []
    start = 0.0
    if registration is None:
        first = find_registration(
            blurred, noisy, options, threads=threads, progress=part(progress, 0, _REGISTERED)
        )
        registration, camera, notes = first.registration, first.camera, list(first.notes)
        start = _REGISTERED
    else:
        camera = CameraFile(registration.camera, "the registration")
        check_registration(registration.camera, blurred)
        zoom = relative_zoom(blurred, noisy)
        if zoom is not None:
            notes.append(
                f"the noisy photo's metadata state {zoom:.2f} times the blurred one's focal length"
            )
    half = (start + 1) / 2
    straight, other, pinhole = straight_pair(blurred, noisy, registration.camera)
    lies = replace(registration, camera=pinhole)
    linear = straight.is_sensors and other.is_sensors
    try:
        seen = registered(unclipped_mean(other.pixels), lies)
        pair = RegisteredPair(straight, other, lies, *seen)
        found = pair.kernel(options, threads, part(progress, start, half) or _silent)
        curved = False
        if found.unexplained > _ALL_BUT and not linear:
            with contextlib.suppress(EstimationError):  # then it stays at the one factor
                second = pair.on_curves().kernel(
                    options, threads, part(progress, half, 1) or _silent
                )
                curved = second.unexplained < found.unexplained
                found = second if curved else found
    except DeshakeError as error:
        error.file = error.file or str(blurred.source)
        raise
    scale = found.scale
    if curved:
        scale *= registration.scale
        notes.append("the photos have tone curves of their own, which were matched")
    notes += found.notes
    kernel = found.kernel
    if found.confidence < _TRUSTED:
        notes.append(
            f"the two photos agree too badly to trust a kernel ({found.confidence:.2f}): the photo "
            "is left as it is; without the noisy photo it can be deblurred blindly"
        )
        kernel = RotationKernel.delta(kernel.camera)
    if progress is not None:
        progress(1.0, "kernel estimated")
    for note in notes:
        _log.warning("%s: %s", blurred.source, note)
    provenance = _provenance((blurred, noisy), options, registration, found)
    provenance |= {"camera": camera.source, "tone_curves": curved, "notes": notes}
    kernel = bent_kernel(kernel, registration.camera, pinhole)
    content = KernelFile(kernel, found.confidence, provenance)
    return PairKernel(content, camera, registration, scale, notes)


def estimate_pair_file(
    blurred: Path,
    noisy: Path,
    output: Path,
    options: EstimateOptions,
    *,
    registration: Path | None = None,
    overwrite: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> PairKernel:
    """Estimate the kernel of a photo from a pair of files, and write its kernel file.

    Raises
    ------
    PhotoError, CalibrationError, KernelFileError, EstimationError
        For the reasons of `read_photo` and `estimate_pair`.
    OutputError
        If the output cannot be written.

    """
    inputs = [path for path in (blurred, noisy, registration) if path is not None]
    check_output(output, *inputs, overwrite=overwrite)
    known = None if registration is None else known_registration(registration)
    found = estimate_pair(
        *read_pair(blurred, noisy, transfer=options.transfer),
        options,
        registration=known,
        threads=threads,
        progress=progress,
    )
    write_kernel(output, found.content, overwrite=overwrite, made_from=[blurred, noisy])
    return found


def _silent(_share: float, _text: str) -> None:
    """Tell nobody."""


def _provenance(
    pair: tuple[Photo, Photo],
    options: EstimateOptions,
    registration: Registration,
    found: PairEstimate,
) -> dict[str, Any]:
    """Tell what shaped the kernel, the camera aside."""
    told = options.provenance()
    goes_by = {name: value for name, value in told.items() if name not in {"region", "estimator"}}
    return {
        "deshake": __version__,
        "command": "estimate-pair",
        "options": goes_by,
        "input_sha256": sha256(pair[0].source),
        "noisy_sha256": sha256(pair[1].source),
        "registration": registration.report(),
        "scale": found.scale,
        "explained": found.explained,
        "unexplained": found.unexplained,
        "scales": [asdict(scale) for scale in found.scales],
    }
