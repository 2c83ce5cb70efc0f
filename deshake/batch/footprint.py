"""How much memory the stages take, by the size of a photo: predicted before any is taken.

The numbers were measured as the most that a process ever held; ``scripts/benchmark_cost.py``
measures them anew.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from deshake.io.picture_size import PictureSize, picture_size
from deshake.pipelines.pair_deblurring import PairRestorationOptions

if TYPE_CHECKING:
    from deshake.batch.plan import Job
    from deshake.batch.work import Work
    from deshake.deconvolution.methods import RestorationOptions

__all__ = ["estimate_memory", "memory_needed", "photo_memory", "restoration_memory"]

_PROCESS: Final = 180e6
"""Libraries, and what is too small to count."""
_PHOTO: Final = {1: 25, 3: 45}
"""Bytes a pixel for reading and writing a photo, by its colours."""
_ESTIMATE: Final = 200e6
"""For an estimate, whose working size is its own."""
_RESTORATION: Final = {1: 80, 3: 130}
"""Bytes a pixel for deblurring, by its colours."""
_PAIR: Final = {1: 150, 3: 260}
"""The same with a noisy photo."""


def memory_needed(job: Job, work: Work) -> int:
    """Predict the bytes of memory that a process takes for a photo, itself included."""
    if job.problem is not None or job.skipped:
        return work.memory(PictureSize(0, 1))
    return work.memory(picture_size(job.source) or PictureSize(0, 1))


def photo_memory(size: PictureSize) -> int:
    """Predict the memory for reading a photo and writing it."""
    return int(_PROCESS + _PHOTO[size.channels] * size.pixels)


def estimate_memory(size: PictureSize) -> int:
    """Predict the memory for estimating a kernel."""
    return photo_memory(size) + int(_ESTIMATE)


def restoration_memory(
    size: PictureSize, options: RestorationOptions | PairRestorationOptions
) -> int:
    """Predict the memory for deblurring."""
    table = _PAIR if isinstance(options, PairRestorationOptions) else _RESTORATION
    return int(_PROCESS + table[size.channels] * size.pixels)
