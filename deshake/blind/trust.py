"""How far to trust a kernel: the chance that deblurring with it makes the photo better."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from deshake.blind.race import Finish

__all__ = ["confidence"]

_EVEN = -2.6
_OF_MARGIN = 25.0  # per unit of margin, -0.04..0.08
_LEAST_MARGIN, _MOST_MARGIN = -0.04, 0.08
_OF_AGREEMENT = 0.7  # per power of ten by which the agreement comes nearer to one
_CLOSEST = 0.005  # of one: agreement cannot be measured better
_OF_WIDTH = 2.1  # per doubling of the width
_NARROWEST, _EVEN_WIDTH, _WIDEST = 3.0, 10.0, 40.0  # px
"""A logistic regression on 52 photos of the benchmark's set to tune on: all 23 kernels that it
gives 0.9 or more there better the photo. The width says most. A small kernel is easily read into a
photo that is sharp, or that the lens left soft; a wide one is seldom found by chance."""


def confidence(ended: Finish) -> float:
    """Return the chance, 0..1, that the winner of a race betters the photo.

    Parameters
    ----------
    ended : Finish
        The race.

    """
    if ended.at_rest:
        return 0.0
    width = np.clip(ended.winner.kernel.extent_px(), _NARROWEST, _WIDEST)
    excess = (
        _EVEN
        + _OF_MARGIN * np.clip(ended.margin, _LEAST_MARGIN, _MOST_MARGIN)
        - _OF_AGREEMENT * np.log10(1 + _CLOSEST - min(ended.agreement, 1.0))
        + _OF_WIDTH * np.log2(width / _EVEN_WIDTH)
    )
    return float(1 / (1 + np.exp(-excess)))
