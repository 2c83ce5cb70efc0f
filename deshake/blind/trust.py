"""How far to trust a kernel: the chance that deblurring with it makes the photo better."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from deshake.blind.race import Finish

__all__ = ["confidence"]

_EVEN_MARGIN = 0.05  # at which, with the agreement below, the chance is a half
_MARGIN_SLOPE = 0.04
_EVEN_AGREEMENT = 0.9
_AGREEMENT_SLOPE = 0.1
"""Set by hand on ten shakes of the benchmark's set to tune on: of eight kernels that it gives more
than 0.9 there, seven better the photo. It is not measured on other scenes and hands."""


def confidence(ended: Finish) -> float:
    """Return the chance, 0..1, that the winner of a race betters the photo.

    Parameters
    ----------
    ended : Finish
        The race.

    """
    if ended.at_rest:
        return 0.0
    excess = (ended.margin - _EVEN_MARGIN) / _MARGIN_SLOPE
    excess += (ended.agreement - _EVEN_AGREEMENT) / _AGREEMENT_SLOPE
    return float(1 / (1 + np.exp(-np.clip(excess, -50, 50))))
