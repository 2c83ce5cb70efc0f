"""The work of ``deblur`` and ``fix`` on one photo, as `Work`."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from deshake.batch.estimate_work import check_inputs, kernel_origin
from deshake.batch.footprint import estimate_memory, restoration_memory, worked_size
from deshake.batch.verdict import UNSHAKEN, blur_words, verdict_figures
from deshake.errors import DeshakeError
from deshake.files.disk import STREAM, sha256
from deshake.files.kernel_file import read_kernel
from deshake.formats.conversion import check_ending
from deshake.pictures.report_pictures import ReportPictures, report_pictures
from deshake.stages.deblurring import deblur_file
from deshake.stages.finishing import AS_IT_IS, FinishingOptions
from deshake.stages.fixing import fix_file
from deshake.stages.inspecting import photo_blur
from deshake.stages.methods import RestorationOptions
from deshake.stages.photo_provenance import photo_origin, registration_origin
from deshake.stages.registering import known_registration

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from deshake.batch.plan import Job
    from deshake.formats.photo import Photo
    from deshake.formats.picture_size import PictureSize
    from deshake.formats.transfer import TransferName
    from deshake.geometry.kernel import RotationKernel
    from deshake.run import Run
    from deshake.stages.estimate_options import EstimateOptions


__all__ = ["Deblur", "Fix"]


@dataclass(frozen=True)
class Fix:
    """``fix``: estimate the kernel of a photo and deblur it, alone or with its ``noisy`` photo.

    Parameters
    ----------
    options : EstimateOptions
        Options of the estimate.
    restoration : RestorationOptions
        Method of the deblurring and its options.
    finish : FinishingOptions
        Options beside the deblurring; the ``mask`` comes from the job.
    room : int, optional
        Bytes that a report has for the photo's pictures; by default there is no report.
    only_shaken : bool
        Whether photos that are sharp, soft or out of focus are passed over.

    """

    options: EstimateOptions
    restoration: RestorationOptions = field(default_factory=RestorationOptions)
    finish: FinishingOptions = AS_IT_IS
    room: int | None = None
    only_shaken: bool = False

    def __call__(self, job: Job, run: Run) -> dict[str, Any]:
        """Fix the photo of a job, or pass it over."""
        passed_over = self.passed_over(job)
        if passed_over is not None:
            return passed_over
        observer = _Observer(self.room)
        result = fix_file(
            job.source,
            job.place,
            job.others.get("kernel"),
            self.options,
            noisy=job.needs.get("noisy"),
            restoration=self.restoration,
            finish=_finishing(self.finish, job),
            observer=observer,
            overwrite=job.overwrite,
            overwrite_others=job.overwrite_others,
            keep_result=job.keeps_result,
            run=run,
        )
        content = result.content
        verdict = verdict_figures(content.kernel, content.confidence, result.notes)
        return result.report() | verdict | self.finish.report() | observer.figures()

    def passed_over(self, job: Job) -> dict[str, Any] | None:
        """Return the verdict on a photo that is passed over, as JSON data; else None.

        Raises
        ------
        PhotoError, EstimationError
            If the photo cannot be read, or has no texture.

        """
        if not self.only_shaken or job.keeps_result:
            return None
        blur = photo_blur(job.source, transfer=self.options.transfer)
        if blur.kind in {"shaken", "unclear"}:
            return None
        return {"verdict": UNSHAKEN, "reason": blur_words(blur.report())}

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:
        """Predict the memory of the work, in bytes."""
        worked = worked_size(size, self.finish)
        blur = self.options.blur_size
        if blur is not None and size.pixels:
            blur *= math.sqrt(worked.pixels / size.pixels)
        bends = self.options.camera.undoes_lens
        needed = restoration_memory(
            size,
            self.restoration,
            threads,
            blur,
            finish=self.finish,
            masked=job.needs.get("mask") is not None,
            bends=bends,
        )
        return max(estimate_memory(worked, threads, colours=True, bends=bends), needed)

    def check(self, job: Job) -> None:
        """Check the inputs, and the name of the result."""
        check_inputs(job)
        check_ending(job.place, job.source)

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the inputs and the options of both stages."""
        origin = photo_origin(
            self.restoration,
            transfer=self.options.transfer,
            finish=_finishing(self.finish, job),
            **_digests(job),
        )
        if self.finish.preview:  # a preview changes the options of the estimate
            return origin
        if "noisy" in job.needs:  # the kernel's provenance has the whole registration
            options = replace(self.options, search_angle=None)
            origin["kernel"] = {"options": options.provenance(pair=True)}
        else:
            origin["kernel"] = kernel_origin(self.options)
        return origin


@dataclass(frozen=True)
class Deblur:
    """``deblur``: deblur a photo with the kernel of a file, alone or with its ``noisy`` photo.

    Parameters
    ----------
    restoration : RestorationOptions
        Method of the deblurring and its options.
    transfer : {"srgb", "linear", "gamma22"}, optional
        The file's transfer curve.
    finish : FinishingOptions
        Options beside the deblurring; the ``mask`` comes from the job.
    search_angle : float, optional
        Range of the search for a registration that is not given, in degrees.
    room : int, optional
        Bytes that a report has for the photo's pictures; by default there is no report.

    """

    restoration: RestorationOptions = field(default_factory=RestorationOptions)
    transfer: TransferName | None = None
    finish: FinishingOptions = AS_IT_IS
    search_angle: float | None = None
    room: int | None = None

    def __call__(self, job: Job, run: Run) -> dict[str, Any]:
        """Deblur the photo of a job."""
        observer = _Observer(self.room)
        content = deblur_file(
            job.source,
            job.needs["kernel"],
            job.output,
            noisy=job.needs.get("noisy"),
            registration=job.needs.get("registration"),
            search_angle=self.search_angle,
            transfer=self.transfer,
            restoration=self.restoration,
            finish=_finishing(self.finish, job),
            observer=observer,
            overwrite=job.overwrite,
            overwrite_others=job.overwrite_others,
            keep_result=job.keeps_result,
            run=run,
        )
        figures = {
            "extent_px": round(content.kernel.extent_px(), 2),
            "confidence": round(content.confidence, 4),
        }
        verdict = verdict_figures(
            content.kernel, content.confidence, content.provenance.get("notes")
        )
        return figures | verdict | self.finish.report() | observer.figures()

    def memory(self, job: Job, size: PictureSize, threads: int) -> int:
        """Predict the memory of the work, in bytes."""
        blur, bends = None, False
        with contextlib.suppress(DeshakeError, OSError):
            file = job.needs["kernel"]
            if str(file) != STREAM:
                status = file.stat()
                extent, pixels, bends = _blur_of(file, (status.st_ino, status.st_mtime_ns))
                blur = extent * math.sqrt(worked_size(size, self.finish).pixels / pixels)
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
        """Check the inputs, the kernel, the registration, and the name of the result."""
        check_inputs(job)
        if str(job.needs["kernel"]) != STREAM:  # standard input can be read only once
            read_kernel(job.needs["kernel"])
        registration = job.needs.get("registration")
        if registration is not None and str(registration) != STREAM:
            known_registration(registration)
        check_ending(job.place, job.source)

    def origin(self, job: Job) -> dict[str, Any]:
        """Return the inputs and the options of the deblurring, and of the kernel."""
        origin = photo_origin(
            self.restoration,
            transfer=self.transfer,
            finish=_finishing(self.finish, job),
            **_digests(job),
        )
        kernel = job.needs["kernel"]
        provenance = {} if str(kernel) == STREAM else read_kernel(kernel).provenance
        registration = job.needs.get("registration")
        if self.restoration.needs_noisy and str(registration) != STREAM:
            given = None if registration is None else known_registration(registration)
            origin["registration"] = registration_origin(given, provenance)
        names = ("options", "input_sha256", "noisy_sha256", "camera")
        return origin | {"kernel": {name: provenance[name] for name in names if name in provenance}}


class _Observer:
    """Makes the pictures of a photo and its result for a report, and measures what moves."""

    def __init__(self, room: int | None) -> None:
        self._room = room
        self._pictures: ReportPictures | None = None
        self._moving: float | None = None

    def __call__(
        self,
        photo: Photo,
        result: Photo,
        kernel: RotationKernel,
        moving: NDArray[np.float32] | None,
    ) -> None:
        if moving is not None:
            self._moving = round(float(moving.mean(dtype=float)), 4)
        if self._room is not None:
            self._pictures = report_pictures(photo, result, kernel, self._room, moving=moving)

    def figures(self) -> dict[str, Any]:
        """Return the share that moves and the pictures, as `run_job` takes them."""
        figures = {"moving": self._moving, "pictures": self._pictures}
        return {name: value for name, value in figures.items() if value is not None}


def _finishing(finish: FinishingOptions, job: Job) -> FinishingOptions:
    """Return the finishing options of a job: with its masks, and the name of its result."""
    return replace(
        finish,
        mask=job.needs.get("mask"),
        moving_mask=job.others.get("moving_mask"),
        file=finish.file.called(job.place),
    )


@lru_cache
def _blur_of(kernel_file: Path, _stamp: tuple[int, int]) -> tuple[float, int, bool]:
    """Return a kernel's extent and frame, in pixels, and whether its camera has a distortion.

    One kernel file for a folder of photos is read once, unless it changes.
    """
    kernel = read_kernel(kernel_file).kernel
    return kernel.extent_px(), math.prod(kernel.camera.shape), not kernel.camera.is_pinhole


def _digests(job: Job) -> dict[str, str]:
    """Return the digests of a job's photos, as `photo_origin` takes them."""
    photos = {"input": job.source, "noisy": job.needs.get("noisy"), "mask": job.needs.get("mask")}
    return {f"{name}_sha256": sha256(path) for name, path in photos.items() if path is not None}
