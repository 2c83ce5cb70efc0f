"""The stages for a blurred and a noisy photo of one scene, from files to the sharp photo.

`fix_pair_file` does all of Sec. 6 in one go: the stages of ``register``, ``estimate-pair`` and
``deblur --noisy``, each with what the one before it found. That is why the results are the same to
the byte.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from deshake.errors import OutputError
from deshake.io.files import STREAM, check_output, default_output
from deshake.io.kernel_file import read_kernel
from deshake.io.photo import read_pair
from deshake.pipelines.finishing import AS_IT_IS, Finish
from deshake.pipelines.fitting import check_registration, fitting_kernel
from deshake.pipelines.outputs import prepared, write_result
from deshake.pipelines.pair_deblurring import PairRestorationOptions, deblur_pair
from deshake.pipelines.pair_stages import estimate_pair
from deshake.pipelines.photo_provenance import photo_provenance
from deshake.pipelines.preview import preview_options, preview_photo
from deshake.pipelines.progress import part
from deshake.pipelines.register import find_registration, known_registration

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.io.transfer import TransferName
    from deshake.pipelines.pair_stages import PairKernel
    from deshake.pipelines.register import Found
    from deshake.pipelines.stages import EstimateOptions

    Progress = Callable[[float, str], None]

__all__ = ["FixedPair", "deblur_pair_file", "fix_pair_file"]

_log = logging.getLogger(__name__)

_REGISTERED, _ESTIMATED = 0.1, 0.4  # of the time


@dataclass(frozen=True, eq=False)
class FixedPair:
    """What was found about a pair on the way to the sharp photo.

    Parameters
    ----------
    registration : Found
        How the noisy photo lies to the blurred one.
    kernel : PairKernel
        The blur.

    """

    registration: Found
    kernel: PairKernel

    def report(self) -> dict[str, Any]:
        """Return the figures of the pair as JSON data."""
        return self.kernel.report() | {
            "notes": self.registration.notes + self.kernel.notes,
            "camera_source": self.registration.camera.source,
        }


def deblur_pair_file(
    source: Path,
    noisy_file: Path,
    kernel_file: Path,
    output: Path | None,
    options: PairRestorationOptions,
    *,
    registration: Path | None = None,
    transfer: TransferName | None = None,
    finish: Finish = AS_IT_IS,
    overwrite: bool = False,
    overwrite_others: bool = False,
    keep_result: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Path:
    """Deblur a photo with a noisy one and the kernel of a file; write the result, return where.

    Without `output`, or in that folder, the result is called ``<stem>.deshaken.<ext>``. The
    sheet of `finish` appears only together with it. With `keep_result` the result is there
    already, and stays as it is.

    Raises
    ------
    PhotoError, KernelFileError, EstimationError
        If a photo, the kernel or the registration cannot be read, or they do not fit each other.
    OutputError
        If the result cannot be written.

    """
    if output is not None and str(output) == STREAM:
        raise OutputError("photos are not written to standard output", hint="name a file with -o")
    path = default_output(source, output, overwrite=overwrite or keep_result)
    inputs = [item for item in (noisy_file, kernel_file, registration) if item is not None]
    check_output(path, *inputs, overwrite=overwrite or keep_result)
    finish.check(path, source, *inputs, overwrite=overwrite_others)
    content = read_kernel(kernel_file)
    known = None if registration is None else known_registration(registration)
    photo, noisy = read_pair(source, noisy_file, transfer=transfer)
    photo = prepared(photo, path, finish)
    if known is not None:
        check_registration(known.camera, photo, registration)
    photo, mask = finish.prepare(photo)
    if finish.preview:
        noisy = preview_photo(noisy)
        known = None if known is None else replace(known, camera=known.camera.scaled(*photo.shape))
    kernel = fitting_kernel(content, photo, kernel_file)
    result = deblur_pair(
        photo,
        noisy,
        kernel,
        options,
        registration=known,
        keep_geometry=finish.keep_geometry,
        threads=threads,
        progress=progress,
    )
    told = photo_provenance(
        photo,
        content,
        options,
        transfer=transfer,
        noisy=noisy,
        registration=known,
        finish=finish,
    )
    write_result(
        path,
        result,
        photo,
        mask,
        kernel,
        finish=finish,
        provenance=told,
        overwrite=overwrite,
        overwrite_others=overwrite_others,
        keep_result=keep_result,
        noisy=noisy_file,
    )
    return path


def fix_pair_file(
    blurred: Path,
    noisy: Path,
    output: Path,
    kernel_file: Path | None,
    options: EstimateOptions,
    *,
    restoration: PairRestorationOptions,
    finish: Finish = AS_IT_IS,
    overwrite: bool = False,
    overwrite_others: bool = False,
    keep_result: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> FixedPair:
    """Register a noisy photo to a blurred one, estimate the kernel, deblur, and write the result.

    Parameters
    ----------
    blurred, noisy : Path
        The photos.
    output : Path
        Where the result goes.
    kernel_file : Path or None
        Where the kernel goes, which appears only together with the result.
    options : EstimateOptions
        What the estimate goes by; region and estimator do not count, and the angle is the blur's.
    restoration : PairRestorationOptions
        How the photo is deblurred.
    finish : Finish
        What is wanted beside it; its sheet, too, appears only together with the result.
    overwrite, overwrite_others : bool
        Whether an existing result, or other existing outputs, may be replaced.
    keep_result : bool
        Whether the result is there already, and stays as it is.
    threads : int, optional
        Threads to use; by default all processors. The result does not depend on it.
    progress : callable, optional
        Told the fraction done and what is being done.

    Raises
    ------
    PhotoError, CalibrationError, KernelFileError, EstimationError
        For the reasons of `read_photo`, `find_registration` and `estimate_pair`.
    OutputError
        If an output cannot be written.

    """
    check_output(output, blurred, noisy, overwrite=overwrite or keep_result)
    if kernel_file is not None:
        check_output(kernel_file, blurred, noisy, output, overwrite=overwrite_others)
    inputs = blurred, noisy, *filter(None, [kernel_file])
    finish.check(output, *inputs, overwrite=overwrite_others)
    whole, f_N = read_pair(blurred, noisy, transfer=options.transfer)
    g, mask = finish.prepare(prepared(whole, output, finish))
    if finish.preview:
        options = preview_options(options, whole, g)
        f_N = preview_photo(f_N)
    del whole
    found = find_registration(
        g, f_N, options, threads=threads, progress=part(progress, 0, _REGISTERED)
    )
    for note in found.notes:
        _log.warning("%s: %s", blurred, note)
    kernel = estimate_pair(
        g,
        f_N,
        options,
        registration=found.registration,
        threads=threads,
        progress=part(progress, _REGISTERED, _ESTIMATED),
    )
    result = deblur_pair(
        g,
        f_N,
        kernel.content.kernel,
        restoration,
        registration=found.registration,
        keep_geometry=finish.keep_geometry,
        threads=threads,
        progress=part(progress, _ESTIMATED, 1),
    )
    told = photo_provenance(
        g,
        kernel.content,
        restoration,
        transfer=options.transfer,
        noisy=f_N,
        registration=found.registration,
        finish=finish,
    )
    write_result(
        output,
        result,
        g,
        mask,
        kernel.content.kernel,
        finish=finish,
        provenance=told,
        kept=None if kernel_file is None else (kernel_file, kernel.content),
        overwrite=overwrite,
        overwrite_others=overwrite_others,
        keep_result=keep_result,
        noisy=noisy,
    )
    return FixedPair(found, kernel)
