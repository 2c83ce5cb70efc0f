"""How much memory the stages take, by the size of a photo: predicted before any is taken.

The numbers were fitted to the most that processes ever held, on photos of 0.05 to 24 megapixels
with blurs of 10 to 150 pixels. A blur far wider than is likely takes more than is predicted.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from deshake.io.picture_size import PictureSize, picture_size
from deshake.pipelines.pair_deblurring import PairRestorationOptions

if TYPE_CHECKING:
    from deshake.batch.plan import Job
    from deshake.batch.work import Work
    from deshake.deconvolution.methods import RestorationOptions

__all__ = ["default_blur", "estimate_memory", "memory_needed", "photo_memory", "restoration_memory"]

_PROCESS: Final = 200e6
"""Libraries, and what is too small to count."""
_PHOTO: Final = {1: 25, 3: 45}
"""Bytes a pixel for reading and writing a photo, by its colours."""
_ESTIMATE: Final = 200e6
"""For an estimate, whose working size is its own."""
_RESTORATION: Final = {1: 70, 3: 115}
"""Bytes a pixel for deblurring, by its colours."""
_PAIR: Final = {1: 150, 3: 240}
"""The same with a noisy photo."""
_BLUR: Final = 28e3
"""Bytes for each square of the blur's extent in pixels: blocks are as wide as the blur needs."""
_THREAD: Final = 45e6
"""For each thread beside the first."""
_LIKELY_BLUR: Final = 0.025
"""Extent of a blur that nothing is known of, in shares of the photo's longer side."""


def memory_needed(job: Job, work: Work, threads: int) -> int:
    """Predict the bytes of memory that a process takes for a photo, itself included."""
    if job.problem is not None or job.skipped:
        return photo_memory(PictureSize(0, 1))
    return work.memory(job, picture_size(job.source) or PictureSize(0, 1), threads)


def photo_memory(size: PictureSize) -> int:
    """Predict the memory for reading a photo and writing it."""
    return int(_PROCESS + _PHOTO[size.channels] * size.pixels)


def estimate_memory(size: PictureSize, threads: int) -> int:
    """Predict the memory for estimating a kernel."""
    return int(photo_memory(size) + _ESTIMATE + _THREAD * (threads - 1))


def restoration_memory(
    size: PictureSize,
    options: RestorationOptions | PairRestorationOptions,
    threads: int,
    blur: float | None = None,
) -> int:
    """Predict the memory for deblurring.

    Parameters
    ----------
    size : PictureSize
        The photo.
    options : RestorationOptions or PairRestorationOptions
        How it is deblurred.
    threads : int
        By so many threads.
    blur : float, optional
        Extent of the blur in pixels; by default a likely one.

    """
    table = _PAIR if isinstance(options, PairRestorationOptions) else _RESTORATION
    extent = default_blur(size) if blur is None else blur
    more = _BLUR * extent**2 + _THREAD * (threads - 1)
    return int(_PROCESS + table[size.channels] * size.pixels + more)


def default_blur(size: PictureSize) -> float:
    """Return the extent in pixels of a blur that is not out of the ordinary; photos are 3:2."""
    return _LIKELY_BLUR * math.sqrt(1.5 * size.pixels)
