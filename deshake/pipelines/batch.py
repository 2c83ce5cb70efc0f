"""Many photos: which there are, where each result goes, and whether it can, before any work."""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from deshake.deconvolution.methods import BY_DEFAULT, RestorationOptions
from deshake.errors import DeshakeError, OutputError, PhotoError
from deshake.io.encoding import READ_ONLY, SUFFIXES
from deshake.io.files import STREAM, check_output, output_name
from deshake.pipelines.blending import find_mask
from deshake.pipelines.comparison import SUFFIX, comparison_name
from deshake.pipelines.file_stages import fix_file, kernel_name
from deshake.pipelines.finishing import AS_IT_IS, Finish
from deshake.pipelines.pair_deblurring import PairRestorationOptions
from deshake.pipelines.pair_fixing import FixedPair, fix_pair_file

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from deshake.pipelines.stages import Estimate, EstimateOptions

__all__ = ["Job", "PlanError", "find_photos", "plan", "run"]

_log = logging.getLogger(__name__)

_RESULT = ".deshaken"


class PlanError(DeshakeError):
    """What was asked for contradicts itself."""


@dataclass(frozen=True)
class Job:
    """One photo to fix.

    Parameters
    ----------
    source : Path
        The photo.
    output : Path
        Where its result goes.
    kernel : Path or None
        Where its kernel goes.
    problem : DeshakeError or None
        Why the outputs cannot go there.
    skipped : bool
        Whether the result is there already, and is to be left as it is.
    overwrite, overwrite_others : bool
        Whether an existing result, or other existing outputs, may be replaced.
    noisy : Path or None
        A sharp but noisy photo of the same scene.
    mask : Path or None
        A picture that tells where the photo is kept.
    sheet : Path or None
        Where a sheet goes that compares before and after.

    """

    source: Path
    output: Path
    kernel: Path | None = None
    problem: DeshakeError | None = None
    skipped: bool = False
    overwrite: bool = False
    overwrite_others: bool = False
    noisy: Path | None = None
    mask: Path | None = None
    sheet: Path | None = None


def find_photos(inputs: Sequence[Path]) -> list[Path]:
    """List the photos among `inputs` and, by name, those in the folders among them.

    In a folder, a photo is a file whose name ends as photos' do; what lies in folders of it, is
    hidden, or is a result of deshake itself (``<stem>.deshaken.<ext>``, ``<stem>.compare.png``) is
    passed over.

    Raises
    ------
    PhotoError
        If a folder has none, or cannot be read.

    """
    photos: list[Path] = []
    for path in inputs:
        if not path.is_dir():
            photos.append(path)
            continue
        try:
            found = sorted(item for item in path.iterdir() if _is_photo(item))
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise PhotoError(f"the folder cannot be read: {reason}", file=path) from error
        if not found:
            raise PhotoError(
                "there are no photos in this folder",
                hint="photos end in .jpg, .tif, .dng and the like; folders in it are not searched",
                file=path,
            )
        photos += found
    return photos


def plan(
    inputs: Sequence[Path],
    output: Path | None = None,
    keep_kernels: Path | None = None,
    *,
    noisy: Path | None = None,
    mask: Path | None = None,
    compare: bool = False,
    overwrite: bool = False,
    skip_existing: bool = False,
) -> list[Job]:
    """Decide where the results for photos go, and check that they can go there.

    Parameters
    ----------
    inputs : sequence of Path
        Photos and folders of photos.
    output : Path, optional
        For one photo, a file or an existing folder. For several, or a folder of them, a folder,
        which is made if it is missing and its parent is there. By default results lie beside the
        photos, called ``<stem>.deshaken.<ext>``.
    keep_kernels : Path, optional
        Folder for the kernels, called ``<stem>.kernel.npz``; made likewise.
    noisy : Path, optional
        A sharp but noisy photo of the same scene, for one photo only.
    mask : Path, optional
        A picture that tells where a photo is kept, for one photo only, or a folder of such, of
        the photos' stems (`find_mask`).
    compare : bool
        Whether sheets that compare before and after go beside the results.
    overwrite : bool
        Whether existing outputs may be replaced.
    skip_existing : bool
        Whether photos whose result exists are left out. Their kernels do not count.

    Returns
    -------
    list of Job
        In the order of the inputs. What is wrong with a single job stands in it.

    Raises
    ------
    PlanError
        If two outputs would be the same file, several photos have one file to go to, one noisy
        photo or one mask, or the noisy photo is the photo itself.
    PhotoError
        For the reasons of `find_photos`.
    OutputError
        If a folder for the outputs is missing and cannot be made.

    """
    photos = find_photos(inputs)
    if output is not None and str(output) == STREAM:
        raise PlanError("photos are not written to standard output", hint="name a file with -o")
    several = len(inputs) > 1 or inputs[0].is_dir()
    masks = mask if mask is not None and mask.is_dir() else None
    if several:
        _check_single(output, noisy, mask if masks is None else None)
    elif noisy is not None and (
        noisy == photos[0] or (_identity(noisy) or 0) == _identity(photos[0])
    ):
        raise PlanError(f"{noisy} is the photo itself", hint="name the noisy one with --noisy")
    into = output is not None and (several or output.is_dir())
    jobs = []
    for source in photos:
        if output is None:
            result = source.with_name(output_name(source))
        else:
            result = output / output_name(source) if into else output
        kernel = None if keep_kernels is None else keep_kernels / kernel_name(source)
        sheet = result.with_name(comparison_name(result)) if compare else None
        kept, problem = (mask, None) if masks is None else _mask(masks, source)
        jobs.append(
            Job(
                source,
                result,
                kernel,
                problem,
                overwrite=overwrite,
                overwrite_others=overwrite or skip_existing,
                noisy=noisy,
                mask=kept,
                sheet=sheet,
            )
        )
    _check_collisions(jobs)
    if output is not None and into:
        _make_folder(output)
    if keep_kernels is not None:
        _make_folder(keep_kernels)
    inputs = [*photos, *filter(None, [noisy]), *(job.mask for job in jobs if job.mask)]
    identities = {identity: source for source in inputs if (identity := _identity(source))}
    return [_checked(job, identities, skip_existing=skip_existing) for job in jobs]


def run(
    job: Job,
    options: EstimateOptions,
    *,
    restoration: RestorationOptions | PairRestorationOptions = BY_DEFAULT,
    finish: Finish = AS_IT_IS,
    linear: bool = False,
    provenance: bool = True,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Estimate | FixedPair | None:
    """Fix the photo of a job; None if it is skipped.

    Parameters
    ----------
    job : Job
        The job.
    options : EstimateOptions
        What the estimate goes by.
    restoration : RestorationOptions or PairRestorationOptions
        How the photo is deblurred: alone, or with the job's noisy photo.
    finish : Finish
        What is wanted beside it, with the job's mask.
    linear, provenance : bool
        As in `fix_file`.
    threads : int, optional
        By default all processors.
    progress : callable, optional
        Told the fraction done and what is done.

    Raises
    ------
    DeshakeError
        The job's problem, or those of `fix_file` or `fix_pair_file`.
    TypeError
        If the job has a noisy photo and the restoration does not know one, or the other way round.

    """
    if job.problem is not None:
        raise job.problem
    if job.skipped:
        _log.info("%s: skipped, %s exists already", job.source, job.output)
        return None
    common: dict[str, Any] = {
        "finish": finish,
        "linear": linear,
        "provenance": provenance,
        "overwrite": job.overwrite,
        "overwrite_others": job.overwrite_others,
        "threads": threads,
        "progress": progress,
    }
    places = job.output, job.kernel
    if isinstance(restoration, PairRestorationOptions) and job.noisy is not None:
        return fix_pair_file(
            job.source, job.noisy, *places, options, restoration=restoration, **common
        )
    if isinstance(restoration, RestorationOptions) and job.noisy is None:
        return fix_file(job.source, *places, options, restoration=restoration, **common)
    raise TypeError("a noisy photo and how to deblur with it are given together")


def _is_photo(path: Path) -> bool:
    return (
        path.suffix.lower() in SUFFIXES | READ_ONLY
        and not path.name.startswith(".")
        and not path.stem.endswith((_RESULT, SUFFIX))
        and path.is_file()
    )


def _check_single(output: Path | None, noisy: Path | None, mask: Path | None) -> None:
    """Refuse what is for one photo only."""
    if output is not None and output.exists() and not output.is_dir():
        raise PlanError(f"{output} is a file; for several photos, -o names a folder")
    if noisy is not None:
        raise PlanError("one noisy photo goes with one blurred photo", hint="fix them in turn")
    if mask is not None:
        raise PlanError("one mask goes with one photo; for several, --mask names a folder")


def _mask(folder: Path, source: Path) -> tuple[Path | None, DeshakeError | None]:
    """Return the mask of a photo, or what is wrong with it."""
    try:
        return find_mask(folder, source), None
    except PhotoError as error:
        return None, error


def _check_collisions(jobs: Sequence[Job]) -> None:
    """Refuse two outputs of one name."""
    taken: dict[str, Job] = {}
    for job in jobs:
        for path in filter(None, (job.output, job.kernel, job.sheet)):
            # A symbolic link is replaced, not followed: its folder counts, and its own name.
            key = os.path.normcase(path.parent.resolve() / path.name)
            other = taken.setdefault(key, job)
            if other is not job:
                raise PlanError(
                    f"{other.source} and {job.source} would both be written to {path}",
                    hint="name each photo once, or fix them one by one",
                )


def _make_folder(path: Path) -> None:
    if path.is_dir():
        return
    try:
        path.mkdir()
    except FileExistsError as error:
        raise OutputError("is not a folder", hint="name a folder", file=path) from error
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise OutputError(
            f"the folder cannot be made: {reason}",
            hint="make it first, or choose another",
            file=path,
        ) from error


def _checked(job: Job, identities: dict[tuple[int, int], Path], *, skip_existing: bool) -> Job:
    """Return a job with what is wrong with its outputs."""
    try:
        for path in filter(None, (job.output, job.kernel, job.sheet)):
            other = identities.get(_identity(path) or (0, 0), job.source)
            check_output(path, job.source, other, overwrite=job.overwrite_others)
    except DeshakeError as error:
        return replace(job, problem=error)
    return replace(
        job, skipped=job.problem is None and skip_existing and os.path.lexists(job.output)
    )


def _identity(path: Path) -> tuple[int, int] | None:
    """Return what tells a file from all others, whatever its names; None: no such file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino
