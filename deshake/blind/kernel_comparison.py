"""The comparison of the kernels in a race, on tiles that no kernel was fitted to.

Each kernel is first judged alone, at the scale where it is a few pixels wide (`margins`). The best
are compared at one scale that resolves most of them well (`side_by_side`). There the judge's energy
separates right kernels from wrong ones. In photos of fine texture, or with a bent tone curve, it
shows no difference; then the sharpness of the restored picture decides (`by_sharpness`). Between
the last few kernels both count (`by_both`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.blind.judge import Judge
from deshake.blind.spot import is_spot

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from deshake.blind.entry import Entry
    from deshake.signal.pyramid import Pyramid

__all__ = ["COLLAPSED", "Comparison"]

Scores = NDArray[np.float64]

COLLAPSED = 10.0
"""Margin: penalty of a small round spot, larger than any gain."""

_OWN_WIDTH = 8.0  # px: width of a kernel at the scale where it is judged alone
_COMMON_WIDTH = 28.0  # px: width of the kernels at the scale of a common comparison
_WIDE = 0.6  # quantile of the kernels' widths; it sets the scale of a common comparison
_WIDEST_OF_MOST = 0.9  # the same quantile, in a comparison where the sharpness counts
_MOST_LOSS = 0.05  # margin: largest loss that a comparison by sharpness counts
_SHARPENING_WORTH = 0.6  # margin per gain of 1 in -ln nsp, where the energy shows no difference
_LAST_SHARPENING_WORTH = 0.3  # the same, between the last kernels
_WIDEST = 48.0  # px at the scale of a common comparison; wider kernels are not compared


class Comparison:
    """Scores of kernels for one photo; a higher one is better.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.

    """

    def __init__(self, pyramid: Pyramid) -> None:
        self.pyramid = pyramid

    def margins(self, entries: Sequence[Entry]) -> Scores:
        """Return the margins of kernels, each at the scale where it is a few pixels wide.

        At that scale a kernel that is too narrow gains nothing, and one that is too wide loses.
        The width of other kernels has no influence on the scale.
        """
        levels = np.array([self._level(entry.width, _OWN_WIDTH) for entry in entries])
        margins = np.empty(len(entries))
        for level in np.unique(levels):
            at = np.flatnonzero(levels == level)
            margins[at] = self._judged([entries[int(i)] for i in at], int(level))
        return margins

    def side_by_side(self, entries: Sequence[Entry]) -> Scores:
        """Return the margins of kernels at one scale that resolves most of them well."""
        return self._compared(entries, _WIDE, self._judged)

    def by_sharpness(self, entries: Sequence[Entry]) -> Scores:
        """Return scores of kernels at one scale by the sharpness of the restored picture.

        This is for photos whose energy shows no difference between kernels. In fine texture the
        true kernel may lose some margin, so a loss against the best margin counts only up to a
        bound.
        """

        def scores(fitting: Sequence[Entry], level: int) -> Scores:
            margins, sharper = self._both(fitting, level)
            counted: Scores = np.maximum(margins, margins.max() - _MOST_LOSS)
            return counted + _SHARPENING_WORTH * sharper

        return self._compared(entries, _WIDEST_OF_MOST, scores)

    def by_both(self, entries: Sequence[Entry]) -> Scores:
        """Return scores of a few kernels at one scale by their margins and by the sharpness."""

        def scores(fitting: Sequence[Entry], level: int) -> Scores:
            margins, sharper = self._both(fitting, level)
            return margins + _LAST_SHARPENING_WORTH * sharper

        return self._compared(entries, _WIDEST_OF_MOST, scores)

    def _both(self, entries: Sequence[Entry], level: int) -> tuple[Scores, Scores]:
        """Return the margins of kernels, and how much sparser the restored picture becomes."""
        judge = Judge.of(self.pyramid, level, [entry.kernel for entry in entries])
        margins = np.array([entry.margin(judge) for entry in entries])
        return margins, np.array([judge.sharpening(entry.kernel) for entry in entries])

    def judge(self, entries: Sequence[Entry]) -> Judge:
        """Return the judge at the common scale, with room for kernels that grow a little."""
        widths = np.array([entry.width for entry in entries])
        level = self._common_level(widths, _WIDE)
        return Judge.of(self.pyramid, level, [entry.kernel for entry in entries])

    def _compared(
        self,
        entries: Sequence[Entry],
        quantile: float,
        scores: Callable[[Sequence[Entry], int], Scores],
    ) -> Scores:
        """Return scores of kernels at the scale that a quantile of their widths sets."""
        widths = np.array([entry.width for entry in entries])
        level = self._common_level(widths, quantile)
        shrink = self.pyramid.at(level).camera.width / self.pyramid.camera.width
        compared = np.full(len(entries), -1.0)
        fits = np.flatnonzero(widths * shrink <= _WIDEST)
        if len(fits):
            compared[fits] = scores([entries[int(i)] for i in fits], level)
        return compared - COLLAPSED * np.array([is_spot(entry.kernel) for entry in entries])

    def _common_level(self, widths: Scores, quantile: float) -> int:
        """Return the scale for a common comparison of kernels with these widths."""
        return self._level(float(np.quantile(widths, quantile)), _COMMON_WIDTH)

    def _level(self, width: float, wanted: float) -> int:
        """Return the scale that reduces a width in pixels of the photo to the wanted width."""
        level = np.ceil(2 * np.log2(max(width / wanted, 1e-9)))
        return int(np.clip(level, 0, self.pyramid.coarsest))

    def _judged(self, entries: Sequence[Entry], level: int) -> Scores:
        judge = Judge.of(self.pyramid, level, [entry.kernel for entry in entries])
        return np.array([entry.margin(judge) for entry in entries])
