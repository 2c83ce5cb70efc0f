"""What is done with each photo: the stages before the deblurring, as `Work`."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from deshake.batch.footprint import estimate_memory, photo_memory
from deshake.errors import KernelFileError, PhotoError
from deshake.io.conversion import check_ending
from deshake.io.files import STREAM, check_input, sha256
from deshake.pipelines.calibration import calibrate_file
from deshake.pipelines.file_stages import estimate_file

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.batch.plan import Job
    from deshake.io.picture_size import PictureSize
    from deshake.pipelines.stages import EstimateOptions

    Progress = Callable[[float, str], None]

__all__ = ["Calibrate", "EstimateBlind", "check_inputs", "kernel_origin"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class EstimateBlind:
    """``estimate-blind``: estimate the kernel of a photo.

    Its ``latent`` picture, and that of its ``tiles``, are kept if they are named.

    Parameters
    ----------
    options : EstimateOptions
        What the estimate goes by.

    """

    options: EstimateOptions

    def __call__(
        self, job: Job, *, threads: int | None, progress: Progress | None
    ) -> dict[str, Any]:
        """Estimate the kernel of a job."""
        return estimate_file(
            job.source,
            job.place,
            self.options,
            latent=job.others.get("latent"),
            tiles=job.others.get("tiles"),
            overwrite=job.overwrite,
            overwrite_others=job.overwrite_others,
            keep_result=job.keeps_result,
            threads=threads,
            progress=progress,
        ).report()

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:  # noqa: ARG002
        """Predict the memory that it takes."""
        return estimate_memory(size, threads)

    def check(self, job: Job) -> None:
        """Check the photo, and the names of the pictures."""
        check_inputs(job)
        for kind in ("latent", "tiles"):
            path = job.others.get(kind)
            if path is not None and str(path) != STREAM:
                check_ending(path, job.source)

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the input and the options."""
        return kernel_origin(self.options) | {"input_sha256": sha256(job.source)}


@dataclass(frozen=True)
class Calibrate:
    """``calibrate``: find the camera of a photo.

    Parameters
    ----------
    focal_px, focal_35mm : float, optional
        Focal length in pixels of the photo, or in millimetres on 35 mm film; by default from EXIF.
    lens, lens_model
        As in `calibrate`.

    """

    focal_px: float | None = None
    focal_35mm: float | None = None
    lens: bool = False
    lens_model: str | None = None

    def __call__(
        self,
        job: Job,
        *,
        threads: int | None,  # noqa: ARG002
        progress: Progress | None,  # noqa: ARG002
    ) -> dict[str, Any]:
        """Calibrate the photo of a job."""
        found = calibrate_file(
            job.source,
            job.output,
            focal_px=self.focal_px,
            focal_35mm=self.focal_35mm,
            lens=self.lens,
            lens_model=self.lens_model,
            overwrite=job.overwrite,
        )
        for line in found.considered:
            _log.info("%s: %s", job.source, line)
        for note in found.notes:
            _log.warning("%s: %s", job.source, note)
        return found.report()

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:  # noqa: ARG002
        """Predict the memory that it takes."""
        return photo_memory(size)

    def check(self, job: Job) -> None:
        """Check the photo."""
        check_inputs(job)

    def origin(self, job: Job) -> dict[str, Any]:  # noqa: ARG002
        """Return nothing: camera files tell no more than what they hold."""
        return {}


def check_inputs(job: Job) -> None:
    """Check that the inputs of a job are there and may be read; raise DeshakeError if not."""
    check_input(job.source, PhotoError)
    for kind, path in job.needs.items():
        check_input(path, KernelFileError if kind in {"kernel", "registration"} else PhotoError)


def kernel_origin(options: EstimateOptions) -> dict[str, Any]:
    """Return what a blind kernel will tell of its options; its camera, if one was named."""
    known: dict[str, Any] = {"options": options.provenance()}
    if options.camera is not None:
        known["camera"] = options.camera.source
    elif options.lens or options.lens_model is not None:
        pass  # the lens's name is told, too, which the photo decides
    elif options.focal_px is not None:
        known["camera"] = f"--focal-px {options.focal_px:g}"
    elif options.focal_35mm is not None:
        known["camera"] = f"--focal-35mm {options.focal_35mm:g}"
    return known
