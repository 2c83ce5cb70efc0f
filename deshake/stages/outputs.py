"""The outputs of a photo: checked before the work, and written together or not at all."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import numpy as np

from deshake.files.disk import check_output
from deshake.files.joint_outputs import joint_outputs
from deshake.files.kernel_file import KernelFile, kernel_bytes
from deshake.formats.conversion import lost
from deshake.formats.photo_writing import encode_photo, photo_bytes
from deshake.pictures.comparison import comparison_sheet
from deshake.stages.photo_provenance import with_photo_provenance

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from deshake.formats.photo import Photo
    from deshake.geometry.kernel import RotationKernel
    from deshake.stages.blending import Mask
    from deshake.stages.finishing import FinishingOptions

    Observer = Callable[[Photo, Photo, RotationKernel, NDArray[np.float32] | None], None]
    """Receives the photo, its result, the kernel, and the share of the photo that was kept where
    something moved, before they are written."""

__all__ = ["Observer", "prepared", "write_result"]

_log = logging.getLogger(__name__)


def prepared(photo: Photo, output: Path, finish: FinishingOptions) -> Photo:
    """Check that the result of a photo can be written; return the photo in its output form.

    The check takes a second and may save minutes of work. A warning names what the output format
    loses.

    Parameters
    ----------
    photo : Photo
        The photo as it was read.
    output : Path
        Path of its result.
    finish : FinishingOptions
        Options of the result.

    Raises
    ------
    OutputError, PhotoError
        If the photo cannot be written under that name, or if the result should be linear and the
        photo is no RAW file.

    """
    if finish.linear:
        photo = photo.in_linear_light()
    form = finish.file.format_of(output, photo)
    photo = finish.file.encoded(photo)
    if form not in {photo.encoding.format, "PNG", "TIFF"}:  # PNG and TIFF lose nothing
        encode_photo(finish.file.fitted(photo, form), form)
    for note in (*photo.notes, *lost(photo.encoding, form)):
        _log.warning("%s: %s", photo.source, note)
    return photo


def write_result(
    output: Path,
    result: Photo,
    photo: Photo,
    mask: Mask | None,
    kernel: RotationKernel,
    *,
    moving: NDArray[np.float32] | None = None,
    finish: FinishingOptions,
    provenance: Mapping[str, Any] | None,
    kept: tuple[Path, KernelFile] | None = None,
    observer: Observer | None = None,
    overwrite: bool = False,
    overwrite_others: bool = False,
    keep_result: bool = False,
    noisy: Path | None = None,
) -> None:
    """Finish a deblurred photo and write it, with its sheet and its kernel file if wanted.

    All outputs appear together or not at all.

    Parameters
    ----------
    output : Path
        Path of the deblurred photo.
    result : Photo
        The deblurred photo.
    photo, mask
        The photo and its mask from `FinishingOptions.prepare`.
    kernel : RotationKernel
        The blur that was removed.
    moving : (H, W) array of float32, optional
        Share of the photo that the result keeps where something moved.
    finish : FinishingOptions
        Options beside the deblurring.
    provenance : mapping or None
        Provenance of the result.
    kept : (Path, KernelFile), optional
        Path and content of a kernel file to write.
    observer : callable, optional
        Receives what is written, see `Observer`.
    overwrite, overwrite_others : bool
        Whether an existing photo, or other existing outputs, may be replaced.
    keep_result : bool
        Whether the photo exists already and is kept; only the other outputs are written.
    noisy : Path, optional
        The noisy photo, if one was used; the result gets no wider read permissions than it.

    Raises
    ------
    OutputError
        If an output cannot be written.

    """
    seen = photo.shape
    photo, mask = finish.before(photo, mask, kernel.camera)
    result = finish.blend(photo, result, mask)
    if observer is not None:
        observer(photo, result, kernel, moving)
    sheet = finish.sheet(output)
    drawn = b"" if sheet is None else comparison_sheet(photo, result, kernel)
    form = finish.file.format_of(output, result)
    result = finish.file.fitted(result, form)
    if provenance is not None:
        result = with_photo_provenance(result, provenance)
    with joint_outputs(photo.source, *filter(None, [noisy])) as add:
        if kept is not None:
            add(kept[0], kernel_bytes(kept[1]), overwrite=overwrite_others)
        if sheet is not None:
            add(sheet, drawn, overwrite=overwrite_others)
        if finish.moving_mask is not None:
            share = np.zeros(seen, np.float32) if moving is None else moving
            add(
                finish.moving_mask, finish.mask_of(share, kernel.camera), overwrite=overwrite_others
            )
        if not keep_result:
            check_output(output, photo.source, overwrite=overwrite)
            data = photo_bytes(output, result, form)
            modified = _time_of(photo.source) if finish.file.keeps_time else None
            add(output, data, overwrite=overwrite, modified=modified)


def _time_of(source: Path) -> int | None:
    """Return the modification time of a photo in nanoseconds; None if it is gone."""
    try:
        return source.stat().st_mtime_ns
    except OSError:
        _log.warning("%s: the photo is gone: its result has another time", source)
        return None
