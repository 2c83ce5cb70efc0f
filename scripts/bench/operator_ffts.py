"""The bare FFTs of an operator's blocks, to compare the cost of operators with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.fft

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.operators.filter_flow import FilterFlow
    from deshake.operators.strips import Strip
    from deshake.operators.transforms import Transforms

__all__ = ["bare_ffts"]


def bare_ffts(flow: FilterFlow, channels: int, own: Transforms | None = None) -> Callable[[], None]:
    """Make the transforms there and back of as many blocks, in the same strips and batches.

    They are those of SciPy, or an operator's own.
    """
    grid = flow.grid
    n = grid.block
    blocks = np.random.default_rng(0).random((channels, grid.batch, n, n), np.float32)

    def work(strip: Strip) -> None:
        for batch in grid.batches(strip):
            part = blocks[:, : batch.stop - batch.start]
            if own is not None:
                own.irfft(own.rfft(part))
            else:
                spectra = scipy.fft.rfft2(part, workers=1)
                scipy.fft.irfft2(spectra, (n, n), overwrite_x=True, workers=1)

    def run() -> None:
        for _ in grid.map_strips(work):
            pass

    return run
