"""How far to trust a kernel: the chance that deblurring with it makes the photo better."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from deshake.blind.race import Finish

__all__ = ["confidence"]


def confidence(ended: Finish) -> float:
    """Return the chance, 0..1, that the winner of a race betters the photo.

    Parameters
    ----------
    ended : Finish
        The race.

    """
    if ended.at_rest:
        return 0.0
    excess = (ended.margin - 0.02) / 0.01 + (ended.agreement - 0.8) / 0.05
    return float(1 / (1 + np.exp(-np.clip(excess, -50, 50))))
