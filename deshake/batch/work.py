"""What is done with each photo: the stages as objects that can be sent to another process."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

from deshake.batch.estimate_work import check_inputs, kernel_origin
from deshake.batch.footprint import estimate_memory, restoration_memory, worked_size
from deshake.deconvolution.methods import BY_DEFAULT, RestorationOptions
from deshake.errors import DeshakeError
from deshake.io.conversion import check_ending
from deshake.io.files import STREAM
from deshake.io.kernel_file import read_kernel
from deshake.pipelines.file_stages import deblur_file, fix_file
from deshake.pipelines.finishing import AS_IT_IS, Finish
from deshake.pipelines.pair_deblurring import PairRestorationOptions
from deshake.pipelines.pair_file_stages import deblur_pair_file, fix_pair_file
from deshake.pipelines.photo_provenance import photo_origin, registration_origin
from deshake.pipelines.register import known_registration

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.batch.plan import Job
    from deshake.io.picture_size import PictureSize
    from deshake.io.transfer import TransferName
    from deshake.pipelines.pair_file_stages import FixedPair
    from deshake.pipelines.stages import Estimate, EstimateOptions

    Progress = Callable[[float, str], None]

__all__ = ["Deblur", "Fix", "Work"]


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

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:
        """Predict the bytes that a process takes for it, itself included."""
        ...

    def check(self, job: Job) -> None:
        """Check what is checked before any work, without reading a photo: for a dry run.

        Raises
        ------
        DeshakeError
            If it cannot be done.

        """
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

    """

    options: EstimateOptions
    restoration: RestorationOptions | PairRestorationOptions = BY_DEFAULT
    finish: Finish = AS_IT_IS

    def __call__(
        self, job: Job, *, threads: int | None, progress: Progress | None
    ) -> dict[str, Any]:
        """Fix the photo of a job."""
        output, kernel = job.place, job.others.get("kernel")
        common: dict[str, Any] = {
            "finish": _with_mask(self.finish, job),
            "overwrite": job.overwrite,
            "overwrite_others": job.overwrite_others,
            "keep_result": job.keeps_result,
            "threads": threads,
            "progress": progress,
        }
        found: FixedPair | Estimate
        if isinstance(self.restoration, PairRestorationOptions):
            found = fix_pair_file(
                job.source,
                job.needs["noisy"],
                output,
                kernel,
                self.options,
                restoration=self.restoration,
                **common,
            )
        else:
            found = fix_file(
                job.source, output, kernel, self.options, restoration=self.restoration, **common
            )
        return found.report() | self.finish.report()

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:
        """Predict the memory that it takes."""
        seen = worked_size(size, self.finish)
        blur = self.options.blur_size
        if blur is not None and size.pixels:
            blur *= math.sqrt(seen.pixels / size.pixels)
        needed = restoration_memory(
            size,
            self.restoration,
            threads,
            blur,
            finish=self.finish,
            masked=job.needs.get("mask") is not None,
            bends=self.options.undoes_lens,
        )
        return max(estimate_memory(seen, threads), needed)

    def check(self, job: Job) -> None:
        """Check the inputs, and the name of the result."""
        check_inputs(job)
        check_ending(job.place, job.source)

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the inputs and the options of both stages."""
        noisy, finish = job.needs.get("noisy"), _with_mask(self.finish, job)
        known = photo_origin(
            job.source,
            self.restoration,
            transfer=self.options.transfer,
            noisy=noisy,
            finish=finish,
        )
        if noisy is None and not finish.preview:  # else the estimate's options are not quite these
            known["kernel"] = kernel_origin(self.options)
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

    """

    restoration: RestorationOptions | PairRestorationOptions = BY_DEFAULT
    transfer: TransferName | None = None
    finish: Finish = AS_IT_IS

    def __call__(
        self, job: Job, *, threads: int | None, progress: Progress | None
    ) -> dict[str, Any]:
        """Deblur the photo of a job."""
        kernel = job.needs["kernel"]
        common: dict[str, Any] = {
            "transfer": self.transfer,
            "finish": _with_mask(self.finish, job),
            "overwrite": job.overwrite,
            "overwrite_others": job.overwrite_others,
            "keep_result": job.keeps_result,
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
        return figures | self.finish.report()

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:
        """Predict the memory that it takes."""
        blur, bends = None, False
        with contextlib.suppress(DeshakeError):
            if str(job.needs["kernel"]) != STREAM:
                kernel = read_kernel(job.needs["kernel"]).kernel
                seen = worked_size(size, self.finish)
                zoom = math.sqrt(seen.pixels / math.prod(kernel.camera.shape))
                blur, bends = zoom * kernel.extent_px(), not kernel.camera.is_pinhole
        return restoration_memory(
            size,
            self.restoration,
            threads,
            blur,
            finish=self.finish,
            masked=job.needs.get("mask") is not None,
            bends=bends,
        )

    def check(self, job: Job) -> None:
        """Check the inputs, the kernel, and the name of the result."""
        check_inputs(job)
        if str(job.needs["kernel"]) != STREAM:  # which can be read but once
            read_kernel(job.needs["kernel"])
        check_ending(job.place, job.source)

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the inputs and the options, and those of the kernel."""
        known = photo_origin(
            job.source,
            self.restoration,
            transfer=self.transfer,
            noisy=job.needs.get("noisy"),
            finish=_with_mask(self.finish, job),
        )
        kernel = job.needs["kernel"]
        told = {} if str(kernel) == STREAM else read_kernel(kernel).provenance
        registration = job.needs.get("registration")
        if isinstance(self.restoration, PairRestorationOptions) and str(registration) != STREAM:
            given = None if registration is None else known_registration(registration)
            known["registration"] = registration_origin(given, told)
        names = ("options", "input_sha256", "noisy_sha256", "camera")
        return known | {"kernel": {name: told[name] for name in names if name in told}}


def _with_mask(finish: Finish, job: Job) -> Finish:
    """Return what is wanted of a job's result, the mask being the job's own."""
    return replace(finish, mask=job.needs.get("mask"))
