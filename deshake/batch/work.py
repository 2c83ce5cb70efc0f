"""What is done with each photo: the stages as objects that can be sent to another process."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

from deshake.batch.footprint import estimate_memory, photo_memory, restoration_memory
from deshake.deconvolution.methods import BY_DEFAULT, RestorationOptions
from deshake.io.files import STREAM, sha256
from deshake.io.kernel_file import read_kernel
from deshake.pipelines.calibration import calibrate_file
from deshake.pipelines.file_stages import deblur_file, estimate_file, fix_file
from deshake.pipelines.finishing import AS_IT_IS, Finish
from deshake.pipelines.pair_deblurring import PairRestorationOptions, deblur_pair_file
from deshake.pipelines.pair_fixing import fix_pair_file
from deshake.pipelines.photo_provenance import photo_origin

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.batch.plan import Job
    from deshake.io.picture_size import PictureSize
    from deshake.io.transfer import TransferName
    from deshake.pipelines.stages import EstimateOptions

    Progress = Callable[[float, str], None]

__all__ = ["Calibrate", "Deblur", "EstimateBlind", "Fix", "Work"]


_log = logging.getLogger(__name__)


class Work(Protocol):
    """What is done with one photo."""

    def __call__(
        self, job: Job, *, threads: int | None, progress: Progress | None
    ) -> dict[str, Any]:
        """Do it, write the outputs, and return its figures as JSON data.

        Raises
        ------
        DeshakeError
            If it cannot be done.

        """
        ...

    def memory(self, size: PictureSize) -> int:
        """Predict the bytes that a process takes for it, itself included."""
        ...

    def origin(self, job: Job) -> dict[str, Any]:
        """Return what its result will tell of where it comes from, as far as that is known before.

        Raises
        ------
        DeshakeError, OSError
            If it cannot be done anyway.

        """
        ...


@dataclass(frozen=True)
class Fix:
    """``fix``: estimate the kernel of a photo and deblur it, alone or with its ``noisy`` photo.

    Parameters
    ----------
    options : EstimateOptions
        What the estimate goes by.
    restoration : RestorationOptions or PairRestorationOptions
        How the photo is deblurred.
    finish : Finish
        What is wanted of the result beside it; the ``mask`` is the job's.
    linear, provenance : bool
        As in `fix_file` and `deblur_file`.

    """

    options: EstimateOptions
    restoration: RestorationOptions | PairRestorationOptions = BY_DEFAULT
    finish: Finish = AS_IT_IS
    linear: bool = False
    provenance: bool = True

    def __call__(
        self, job: Job, *, threads: int | None, progress: Progress | None
    ) -> dict[str, Any]:
        """Fix the photo of a job."""
        output, kernel = _output(job), job.others.get("kernel")
        common: dict[str, Any] = {
            "overwrite": job.overwrite,
            "finish": replace(self.finish, mask=job.needs.get("mask")),
            "linear": self.linear,
            "provenance": self.provenance,
            "overwrite_others": job.overwrite_others,
            "threads": threads,
            "progress": progress,
        }
        if isinstance(self.restoration, PairRestorationOptions):
            return fix_pair_file(
                job.source,
                job.needs["noisy"],
                output,
                kernel,
                self.options,
                restoration=self.restoration,
                **common,
            ).report()
        return fix_file(
            job.source, output, kernel, self.options, restoration=self.restoration, **common
        ).report()

    def memory(self, size: PictureSize) -> int:
        """Predict the memory that it takes."""
        return max(estimate_memory(size), restoration_memory(size, self.restoration))

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the inputs and the options of both stages."""
        noisy, finish = job.needs.get("noisy"), replace(self.finish, mask=job.needs.get("mask"))
        known = photo_origin(
            job.source,
            self.restoration,
            transfer=self.options.transfer,
            noisy=noisy,
            finish=finish,
        )
        if noisy is None and not finish.preview:  # else the estimate's options are not quite these
            known["kernel"] = _kernel_origin(self.options)
        return known


@dataclass(frozen=True)
class Deblur:
    """``deblur``: deblur a photo with the kernel of a file, alone or with its ``noisy`` photo.

    Parameters
    ----------
    restoration : RestorationOptions or PairRestorationOptions
        How.
    transfer : {"srgb", "linear", "gamma22"}, optional
        The file's transfer curve.
    finish : Finish
        What is wanted of the result beside it; the ``mask`` is the job's.
    linear, provenance : bool
        As in `fix_file` and `deblur_file`.

    """

    restoration: RestorationOptions | PairRestorationOptions = BY_DEFAULT
    transfer: TransferName | None = None
    finish: Finish = AS_IT_IS
    linear: bool = False
    provenance: bool = True

    def __call__(
        self, job: Job, *, threads: int | None, progress: Progress | None
    ) -> dict[str, Any]:
        """Deblur the photo of a job."""
        kernel = job.needs["kernel"]
        common: dict[str, Any] = {
            "transfer": self.transfer,
            "finish": replace(self.finish, mask=job.needs.get("mask")),
            "linear": self.linear,
            "provenance": self.provenance,
            "overwrite": job.overwrite,
            "threads": threads,
            "progress": progress,
        }
        figures: dict[str, Any] = {}
        if str(kernel) != STREAM:  # which can be read but once
            content = read_kernel(kernel)
            figures["extent_px"] = round(content.kernel.extent_px(), 2)
            figures["confidence"] = round(content.confidence, 4)
        if isinstance(self.restoration, PairRestorationOptions):
            deblur_pair_file(
                job.source,
                job.needs["noisy"],
                kernel,
                job.output,
                self.restoration,
                registration=job.needs.get("registration"),
                **common,
            )
        else:
            deblur_file(job.source, kernel, job.output, restoration=self.restoration, **common)
        return figures

    def memory(self, size: PictureSize) -> int:
        """Predict the memory that it takes."""
        return restoration_memory(size, self.restoration)

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the inputs and the options, and those of the kernel."""
        finish = replace(self.finish, mask=job.needs.get("mask"))
        known = photo_origin(
            job.source,
            self.restoration,
            transfer=self.transfer,
            noisy=job.needs.get("noisy"),
            finish=finish,
        )
        kernel = job.needs["kernel"]
        told = {} if str(kernel) == STREAM else read_kernel(kernel).provenance
        names = ("options", "input_sha256", "noisy_sha256", "camera")
        return known | {"kernel": {name: told[name] for name in names if name in told}}


@dataclass(frozen=True)
class EstimateBlind:
    """``estimate-blind``: estimate the kernel of a photo; its ``latent`` picture is kept if named.

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
            _output(job),
            self.options,
            latent=job.others.get("latent"),
            overwrite=job.overwrite,
            threads=threads,
            progress=progress,
        ).report()

    def memory(self, size: PictureSize) -> int:
        """Predict the memory that it takes."""
        return estimate_memory(size)

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the input and the options."""
        return _kernel_origin(self.options) | {"input_sha256": sha256(job.source)}


@dataclass(frozen=True)
class Calibrate:
    """``calibrate``: find the camera of a photo.

    Parameters
    ----------
    focal_px, focal_35mm : float, optional
        Focal length in pixels of the photo, or in millimetres on 35 mm film; by default from EXIF.

    """

    focal_px: float | None = None
    focal_35mm: float | None = None

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
            overwrite=job.overwrite,
        )
        for line in found.considered:
            _log.info("%s: %s", job.source, line)
        for note in found.notes:
            _log.warning("%s: %s", job.source, note)
        return found.report()

    def memory(self, size: PictureSize) -> int:
        """Predict the memory that it takes."""
        return photo_memory(size)

    def origin(self, job: Job) -> dict[str, Any]:  # noqa: ARG002
        """Return nothing: camera files tell no more than what they hold."""
        return {}


def _output(job: Job) -> Path:
    """Return where the result goes, which these stages always know."""
    if job.output is None:
        raise ValueError("this stage has a result")
    return job.output


def _kernel_origin(options: EstimateOptions) -> dict[str, Any]:
    """Return what a blind kernel will tell of its options; its camera, if one was named."""
    known: dict[str, Any] = {"options": options.provenance()}
    if options.camera is not None:
        known["camera"] = options.camera.source
    elif options.focal_px is not None:
        known["camera"] = f"--focal-px {options.focal_px:g}"
    elif options.focal_35mm is not None:
        known["camera"] = f"--focal-35mm {options.focal_35mm:g}"
    return known
