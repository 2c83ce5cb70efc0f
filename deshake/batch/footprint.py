"""Predict the memory of the stages by the size of a photo, before the work.

The numbers were fitted to the peak memory of processes, on photos of 0.05 to 24 megapixels with
blurs of 10 to 150 pixels. A blur far wider than is likely takes more than is predicted.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from deshake.formats.picture_size import PictureSize, picture_size

if TYPE_CHECKING:
    from deshake.batch.plan import Job
    from deshake.batch.work import Work
    from deshake.stages.finishing import FinishingOptions
    from deshake.stages.methods import RestorationOptions

__all__ = [
    "default_blur",
    "estimate_memory",
    "memory_needed",
    "pair_memory",
    "photo_memory",
    "restoration_memory",
    "worked_size",
]

_PROCESS: Final = 200e6
"""Bytes of the libraries, and of small arrays."""
_PHOTO: Final = {1: 16, 3: 28}
"""Bytes a pixel for reading a photo, by its colours; a mosaic of a sensor takes no more."""
_ESTIMATE: Final = 300e6
"""Bytes of an estimate from one photo at its own working sizes; a few wide shakes take more."""
_ESTIMATE_THREAD: Final = 150e6
"""Bytes of each thread of such an estimate beside the first."""
_SCALES: Final = 14
"""Bytes a pixel for the luminance of such a photo, at all scales."""
_COLOURS: Final = {1: 0, 3: 12}
"""Bytes a pixel for the colours of such a photo, where they stay in memory."""
_PAIR_ESTIMATE: Final = 200e6
"""Bytes of an estimate from a pair at its own working size."""
_LUMINANCE: Final = {1: 9, 3: 17}
"""Bytes a pixel for such an estimate, by the colours, beside each photo."""
_RESTORATION: Final = {1: 70, 3: 115}
"""Bytes a pixel for deblurring, by its colours."""
_PAIR: Final = {1: 180, 3: 290}
"""The same with a noisy photo."""
_MOVING: Final = 80
"""Bytes a pixel for the search of parts that moved, beside the photo and its result."""
_MOST_MOVING: Final = 8e6
"""Pixels of that search, at most."""
_MASK: Final = 4
"""Bytes a pixel for a mask."""
_LENS: Final = 14
"""Bytes a pixel for straightening each photo."""
_KEPT: Final = 27
"""The same if the geometry is kept: the straight picture is larger than the photo."""
_BLUR: Final = 28e3
"""Bytes for each square of the blur's extent in pixels: blocks are as wide as the blur needs."""
_THREAD: Final = 45e6
"""Bytes of each thread beside the first."""
_LIKELY_BLUR: Final = 0.025
"""Extent of an unknown blur, as a share of the photo's longer side."""


def memory_needed(job: Job, work: Work, threads: int) -> int:
    """Predict the bytes of memory that a process takes for a photo, with those of the process."""
    if job.problem is not None or job.skipped:
        return photo_memory(PictureSize(0, 1))
    return work.memory(job, picture_size(job.source) or PictureSize(0, 1), threads)


def photo_memory(size: PictureSize) -> int:
    """Predict the memory for reading a photo."""
    return int(_PROCESS + _PHOTO[size.channels] * size.pixels)


def estimate_memory(
    size: PictureSize, threads: int, *, colours: bool = False, bends: bool = False
) -> int:
    """Predict the memory for estimating a kernel from one photo, reading included.

    Parameters
    ----------
    size : PictureSize
        The photo.
    threads : int
        Number of threads.
    colours : bool
        Whether the colours of the photo stay in memory meanwhile.
    bends : bool
        Whether lens distortion is removed.

    """
    each = _SCALES + (_COLOURS[size.channels] if colours else 0) + (_LENS if bends else 0)
    more = _ESTIMATE + _ESTIMATE_THREAD * (threads - 1)
    return int(max(photo_memory(size), _PROCESS + each * size.pixels + more))


def pair_memory(size: PictureSize, threads: int) -> int:
    """Predict the memory for registering a pair of one size, or for estimating its kernel."""
    each = 2 * (_PHOTO[size.channels] + _LUMINANCE[size.channels])
    return int(_PROCESS + each * size.pixels + _PAIR_ESTIMATE + _THREAD * (threads - 1))


def restoration_memory(
    size: PictureSize,
    options: RestorationOptions,
    threads: int,
    blur: float | None = None,
    *,
    finish: FinishingOptions | None = None,
    masked: bool = False,
    bends: bool = False,
) -> int:
    """Predict the memory for deblurring, reading included.

    Parameters
    ----------
    size : PictureSize
        The photo as it is read.
    options : RestorationOptions
        Method of the deblurring and its options.
    threads : int
        Number of threads.
    blur : float, optional
        Extent of the blur in pixels of the size that is worked at; by default a likely one.
    finish : FinishingOptions, optional
        Options beside the deblurring; by default none.
    masked : bool
        Whether a mask is read with each photo.
    bends : bool
        Whether lens distortion is removed.

    """
    worked = worked_size(size, finish)
    paired = options.needs_noisy
    each = (_PAIR if paired else _RESTORATION)[worked.channels]
    if bends:
        each += (_KEPT if finish and finish.keep_geometry else _LENS) * (2 if paired else 1)
    mask = _MASK if masked else 0
    extent = default_blur(worked) if blur is None else blur
    more = _BLUR * extent**2 + _THREAD * (threads - 1)
    reading = photo_memory(size) + mask * size.pixels
    needed = max(reading, _PROCESS + (each + mask) * worked.pixels + more)
    if finish is not None and finish.protect_moving:
        search = _MOVING * min(worked.pixels, _MOST_MOVING) + 4 * worked.channels * worked.pixels
        needed = max(needed, photo_memory(worked) + mask * worked.pixels + search)
    return int(needed)


def worked_size(size: PictureSize, finish: FinishingOptions | None) -> PictureSize:
    """Return the size at which a photo is worked on: that of its preview, if one is wanted."""
    if finish is None or not finish.preview:
        return size
    from deshake.stages.preview import preview_side  # noqa: PLC0415 - `inspect` starts without it

    side = _longer_side(size)
    share = min(preview_side(side) / side, 1) if side else 1
    return PictureSize(round(size.pixels * share**2), size.channels)


def default_blur(size: PictureSize) -> float:
    """Return the extent of a likely blur in pixels; photos count as 3:2."""
    return _LIKELY_BLUR * _longer_side(size)


def _longer_side(size: PictureSize) -> float:
    return math.sqrt(1.5 * size.pixels)
