"""All stages of a photo in one, from file to file: the work of ``fix``.

``estimate-blind``, ``register``, ``estimate-pair`` and ``deblur`` call the same functions. So the
results have the same bytes. All outputs are checked before the work begins, and appear whole or not
at all.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING

from deshake.files.disk import check_output
from deshake.formats.photo import read_pair, read_photo
from deshake.run import Run
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.deblurring import deblur
from deshake.stages.finishing import AS_IT_IS, FinishingOptions
from deshake.stages.methods import RestorationOptions, default_method
from deshake.stages.outputs import prepared, write_result
from deshake.stages.pair_estimate import estimate_pair
from deshake.stages.photo_provenance import photo_provenance
from deshake.stages.preview import preview_estimate, preview_options, preview_photo
from deshake.stages.registering import find_registration

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.formats.photo import Photo
    from deshake.stages.estimate_options import EstimateOptions
    from deshake.stages.estimate_result import Estimate
    from deshake.stages.outputs import Observer

__all__ = ["fix_file"]

_log = logging.getLogger(__name__)

_ESTIMATE_PIXELS = 8e6
"""Pixels whose deblurring takes about as long as an estimate, which has a fixed size."""
_REGISTERED, _PAIR_ESTIMATED = (
    0.1,
    0.4,
)  # shares of the time, with a noisy photo


def fix_file(
    source: Path,
    output: Path,
    kernel_file: Path | None,
    options: EstimateOptions,
    *,
    noisy: Path | None = None,
    restoration: RestorationOptions | None = None,
    finish: FinishingOptions = AS_IT_IS,
    observer: Observer | None = None,
    overwrite: bool = False,
    overwrite_others: bool = False,
    keep_result: bool = False,
    run: Run = Run(),
) -> Estimate:
    """Estimate the kernel of a photo, deblur the photo with it, and write both.

    Parameters
    ----------
    source : Path
        The photo.
    output : Path
        Path of the result.
    kernel_file : Path or None
        Path of the kernel file, which appears only together with the result.
    options : EstimateOptions
        Options of the estimate; with a noisy photo, region and estimator are ignored.
    noisy : Path, optional
        A noisy photo of the same scene, used for the kernel and for the deblurring.
    restoration : RestorationOptions, optional
        Method of the deblurring and its options; by default the default method.
    finish : FinishingOptions
        Options beside the deblurring; the sheet, too, appears only together with the result.
    observer : callable, optional
        Receives the photo, its result and the kernel, before they are written.
    overwrite, overwrite_others : bool
        Whether an existing result, or other existing outputs, may be replaced.
    keep_result : bool
        Whether the result exists already and is kept.
    run : Run, optional
        Threads to use, and who receives the progress.

    Raises
    ------
    PhotoError, CalibrationError, KernelFileError, EstimationError
        For the reasons of `read_photo`, `estimate_blind`, `find_registration` and `estimate_pair`.
    OutputError
        If an output cannot be written.

    """
    restoration = restoration or RestorationOptions(default_method(noisy=noisy is not None))
    inputs = [path for path in (source, noisy) if path is not None]
    check_output(output, *inputs, overwrite=overwrite or keep_result)
    if kernel_file is not None:
        check_output(kernel_file, *inputs, output, overwrite=overwrite_others)
    finish.check(output, *inputs, *filter(None, [kernel_file]), overwrite=overwrite_others)
    whole, other = _read(source, noisy, options)
    whole = prepared(whole, output, finish)
    photo, mask = finish.prepare(whole)
    if other is not None and finish.preview:
        other = preview_photo(other)
    if other is None:
        pixels = photo.shape[0] * photo.shape[1]
        share = _ESTIMATE_PIXELS / (_ESTIMATE_PIXELS + pixels)
    else:
        share = _PAIR_ESTIMATED
    first, second = run.part(0, share), run.part(share, 1)
    if other is not None:
        by = preview_options(options, whole, photo) if finish.preview else options
        estimate = _pair_estimate(photo, other, by, first)
    elif finish.preview:
        estimate = preview_estimate(whole, photo, options, run=first)
    else:
        estimate = estimate_blind(photo, options, run=first)
    del whole
    kernel = estimate.content.kernel
    result, kept = deblur(
        photo,
        kernel,
        restoration,
        noisy=other,
        registration=estimate.registration,
        keep_geometry=finish.keep_geometry,
        protect_moving=finish.protect_moving,
        run=second,
    )
    provenance = photo_provenance(
        photo,
        estimate.content,
        restoration,
        transfer=options.transfer,
        noisy=other,
        registration=estimate.registration,
        finish=finish,
        mask=mask,
    )
    write_result(
        output,
        result,
        photo,
        mask,
        kernel,
        moving=kept,
        finish=finish,
        provenance=provenance,
        observer=observer,
        kept=None if kernel_file is None else (kernel_file, estimate.content),
        overwrite=overwrite,
        overwrite_others=overwrite_others,
        keep_result=keep_result,
        noisy=noisy,
    )
    return estimate


def _read(source: Path, noisy: Path | None, options: EstimateOptions) -> tuple[Photo, Photo | None]:
    """Read the photo, and the noisy one if there is one."""
    if noisy is None:
        return read_photo(source, transfer=options.transfer), None
    return read_pair(source, noisy, transfer=options.transfer)


def _pair_estimate(
    blurred: Photo,
    noisy: Photo,
    options: EstimateOptions,
    run: Run,
) -> Estimate:
    """Register the noisy photo and estimate the kernel, as the two commands do in turn."""
    share = _REGISTERED / _PAIR_ESTIMATED
    match = find_registration(blurred, noisy, options, run=run.part(0, share))
    for note in match.notes:
        _log.warning("%s: %s", blurred.source, note)
    estimate = estimate_pair(
        blurred,
        noisy,
        options,
        registration=match.registration,
        run=run.part(share, 1),
    )
    return replace(estimate, camera=match.camera, notes=match.notes + estimate.notes)
