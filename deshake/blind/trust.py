"""The confidence of a kernel: the chance that deblurring with it improves the photo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from deshake.blind.race import Finish

__all__ = ["confidence"]

_EVEN = -2.6  # log odds: the constant term
_OF_MARGIN = 25.0  # log odds per unit of margin
_LEAST_MARGIN, _MOST_MARGIN = -0.04, 0.08  # margin; values beyond count as these
_OF_AGREEMENT = 0.7  # log odds per power of ten by which the agreement comes nearer to one
_CLOSEST = 0.005  # agreement: smallest difference from one that can be measured
_OF_WIDTH = 2.1  # log odds per doubling of the width
_NARROWEST, _EVEN_WIDTH, _WIDEST = 3.0, 10.0, 40.0  # px of the photo; widths beyond count as these
"""The constants come from a logistic regression on 52 photos of the benchmark's tuning set. There
all 23 kernels with a confidence of 0.9 or more improve the photo. The width has the most
influence. A sharp photo, or one from a soft lens, easily gives a small kernel by chance. It seldom
gives a wide one."""


def confidence(ended: Finish) -> float:
    """Return the chance, 0..1, that the winner of a race improves the photo.

    Parameters
    ----------
    ended : Finish
        The result of the race.

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
