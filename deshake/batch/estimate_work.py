"""The work of the stages before the deblurring on one photo, as `Work`."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from deshake.batch.footprint import estimate_memory, pair_memory, photo_memory
from deshake.errors import KernelFileError, PhotoError
from deshake.files.disk import STREAM, check_input, sha256
from deshake.formats.conversion import check_ending
from deshake.stages.calibration import calibrate_file
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.estimating import estimate_file
from deshake.stages.registering import known_registration, register_file, register_options

if TYPE_CHECKING:
    from deshake.batch.plan import Job
    from deshake.formats.picture_size import PictureSize
    from deshake.run import Run
    from deshake.stages.estimate_options import EstimateOptions


__all__ = ["Calibrate", "EstimateKernel", "Register", "check_inputs", "kernel_origin"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class EstimateKernel:
    """``estimate-blind`` and ``estimate-pair``: estimate the kernel of a photo.

    The ``noisy`` photo of a job and its ``registration`` help, if they are named. The ``latent``
    picture of a blind estimate, and that of its ``tiles``, are kept if they are named.

    Parameters
    ----------
    options : EstimateOptions
        Options of the estimate.

    """

    options: EstimateOptions

    def __call__(self, job: Job, run: Run) -> dict[str, Any]:
        """Estimate the kernel of a job."""
        return estimate_file(
            job.source,
            job.place,
            self.options,
            noisy=job.needs.get("noisy"),
            registration=job.needs.get("registration"),
            latent=job.others.get("latent"),
            tiles=job.others.get("tiles"),
            overwrite=job.overwrite,
            overwrite_others=job.overwrite_others,
            keep_result=job.keeps_result,
            run=run,
        ).report()

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:
        """Predict the memory of the work, in bytes."""
        if "noisy" in job.needs:
            return pair_memory(size, threads)
        bends = self.options.camera.undoes_lens
        return estimate_memory(size, threads, colours="tiles" in job.others, bends=bends)

    def check(self, job: Job) -> None:
        """Check the photos, the registration, and the names of the pictures."""
        check_inputs(job)
        registration = job.needs.get("registration")
        if registration is not None and str(registration) != STREAM:  # readable only once
            known_registration(registration)
        _check_pictures(job)

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the inputs and the options."""
        noisy, registration = job.needs.get("noisy"), job.needs.get("registration")
        origin = kernel_origin(self.options, pair=noisy is not None)
        origin["input_sha256"] = sha256(job.source)
        if noisy is not None:
            origin["noisy_sha256"] = sha256(noisy)
        if registration is not None and str(registration) != STREAM:
            origin["registration"] = known_registration(registration).report()
        return origin


@dataclass(frozen=True)
class Register:
    """``register``: register the ``noisy`` photo of a job to its blurred one.

    A checkerboard of both, the ``preview``, is kept if it is named.

    Parameters
    ----------
    options : EstimateOptions
        Options; only the camera, `transfer` and `search_angle` count.

    """

    options: EstimateOptions

    def __call__(self, job: Job, run: Run) -> dict[str, Any]:
        """Register the photos of a job."""
        return register_file(
            job.source,
            job.needs["noisy"],
            job.place,
            self.options,
            preview=job.others.get("preview"),
            overwrite=job.overwrite,
            overwrite_others=job.overwrite_others,
            keep_result=job.keeps_result,
            run=run,
        ).report()

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:  # noqa: ARG002
        """Predict the memory of the work, in bytes."""
        return pair_memory(size, threads)

    def check(self, job: Job) -> None:
        """Check the photos, and the name of the preview."""
        check_inputs(job)
        _check_pictures(job)

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the inputs and the options."""
        origin = {
            "options": register_options(self.options),
            "input_sha256": sha256(job.source),
            "noisy_sha256": sha256(job.needs["noisy"]),
        }
        source = self.options.camera.source
        return origin if source is None else origin | {"camera": source}


@dataclass(frozen=True)
class Calibrate:
    """``calibrate``: determine the camera of a photo.

    Parameters
    ----------
    camera : CameraChoice
        The user's choice of focal length and lens; by default EXIF decides.

    """

    camera: CameraChoice = field(default_factory=CameraChoice)

    def __call__(
        self,
        job: Job,
        run: Run,  # noqa: ARG002
    ) -> dict[str, Any]:
        """Calibrate the photo of a job."""
        calibration = calibrate_file(
            job.source,
            job.output,
            focal_px=self.camera.focal_px,
            focal_35mm=self.camera.focal_35mm,
            lens=self.camera.looks_up_lens,
            lens_model=self.camera.lens_model,
            overwrite=job.overwrite,
        )
        for line in calibration.considered:
            _log.info("%s: %s", job.source, line)
        for note in calibration.notes:
            _log.warning("%s: %s", job.source, note)
        return calibration.report()

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:  # noqa: ARG002
        """Predict the memory of the work, in bytes."""
        return photo_memory(size)

    def check(self, job: Job) -> None:
        """Check the photo."""
        check_inputs(job)

    def origin(self, job: Job) -> dict[str, Any]:  # noqa: ARG002
        """Return nothing: camera files have no provenance."""
        return {}


def check_inputs(job: Job) -> None:
    """Check that the inputs of a job exist and are readable.

    Raises
    ------
    PhotoError, KernelFileError
        If an input does not exist, or is not readable.

    """
    check_input(job.source, PhotoError)
    for kind, path in job.needs.items():
        check_input(path, KernelFileError if kind in {"kernel", "registration"} else PhotoError)


def kernel_origin(options: EstimateOptions, *, pair: bool = False) -> dict[str, Any]:
    """Return the options in a kernel's provenance, and its camera if the user names one."""
    origin: dict[str, Any] = {"options": options.provenance(pair=pair)}
    source = options.camera.source
    return origin if source is None else origin | {"camera": source}


def _check_pictures(job: Job) -> None:
    """Check that the names of the pictures beside the result end in supported formats."""
    for path in job.others.values():
        if str(path) != STREAM:
            check_ending(path, job.source)
