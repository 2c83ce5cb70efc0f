"""The comparison of the kernels in a race, on tiles that no kernel was fitted to.

Each kernel is judged at the scale that resolves it well, whatever the width of the others. At a
coarser scale right and wrong kernels differ little; at a finer one a wide kernel is a thin line
that only few tiles can hold. Two measures count: the judge's margin, and how much sparser the
restored picture is. In most photos the margin separates right kernels from wrong ones. In photos of
fine texture, or with a bent tone curve, it shows little difference; there the sparsity decides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.blind.judge import Judge
from deshake.blind.spot import is_spot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.entry import Entry
    from deshake.signal.pyramid import Pyramid

__all__ = ["COLLAPSED", "Comparison"]

Scores = NDArray[np.float64]

COLLAPSED = 10.0
"""Margin: penalty of a small round spot, larger than any gain."""

_WIDTH = 28.0  # px of a kernel at the scale where it is judged
_SHARPENING_WORTH = 0.3  # margin per gain of 1 in -ln nsp


class Comparison:
    """Scores of kernels for one photo; a higher one is better.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.

    """

    def __init__(self, pyramid: Pyramid) -> None:
        self.pyramid = pyramid

    def scores(self, entries: Sequence[Entry]) -> Scores:
        """Return the margins of kernels, and the worth of the sparsity of the restored picture."""
        scores = np.empty(len(entries))
        levels = np.array([self._level(entry) for entry in entries])
        for level in np.unique(levels):
            at = [int(i) for i in np.flatnonzero(levels == level)]
            judge = self._judge([entries[i] for i in at], int(level))
            for i in at:
                sharper = judge.sharpening(entries[i].kernel)
                scores[i] = entries[i].margin(judge) + _SHARPENING_WORTH * sharper
        return scores - COLLAPSED * np.array([is_spot(entry.kernel) for entry in entries])

    def judge(self, entry: Entry) -> Judge:
        """Return the judge at the scale of a kernel, with room for one that grows a little."""
        return self._judge([entry], self._level(entry))

    def _judge(self, entries: Sequence[Entry], level: int) -> Judge:
        return Judge.of(self.pyramid, level, [entry.kernel for entry in entries])

    def _level(self, entry: Entry) -> int:
        """Return the scale that resolves a kernel well."""
        level = np.ceil(2 * np.log2(max(entry.width / _WIDTH, 1e-9)))
        return int(np.clip(level, 0, self.pyramid.coarsest))
