"""The confidence of a kernel: the chance that deblurring with it improves the photo."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from deshake.blind.race import Finish

__all__ = ["DOUBTFUL", "confidence", "two_digits"]

DOUBTFUL: Final = 0.8
"""Confidence below which a kernel is doubtful, and the user should look at the result."""

_EVEN = -4.9  # log odds: the constant term
_OF_MARGIN = 15.0  # log odds per unit of margin
_LEAST_MARGIN, _MOST_MARGIN = -0.04, 0.12  # margin; values beyond count as these
_OF_AGREEMENT = 1.7  # log odds per power of ten by which the agreement comes nearer to one
_CLOSEST = 0.005  # agreement: smallest difference from one that can be measured
_OF_MATCH = 17.0  # log odds per correlation of 1 of the spectra
_MOST_MATCH = 0.4  # correlation; a higher one counts as this, and a negative one as none
"""The constants come from a logistic regression on results for 42 photos of the benchmark's
tuning set, of which sixteen were not shaken; the constant term is .5 less, because a wrong kernel
harms a sharp photo more than a right one improves a shaken photo. Margin and agreement may speak
for a kernel that a sharp photo, or one from a soft lens, gives by chance. The spectra of such a
photo do not match it: eight sharp ones have at most 0.09, and most shaken ones 0.2 to 0.4."""


def confidence(ended: Finish) -> float:
    """Return the chance, 0..1, that the winner of a race improves the photo."""
    if ended.at_rest:
        return 0.0
    excess = (
        _EVEN
        + _OF_MARGIN * np.clip(ended.margin, _LEAST_MARGIN, _MOST_MARGIN)
        - _OF_AGREEMENT * np.log10(1 + _CLOSEST - min(ended.agreement, 1.0))
        + _OF_MATCH * np.clip(ended.match, 0, _MOST_MATCH)
    )
    return float(1 / (1 + np.exp(-excess)))


def two_digits(confidence: float) -> str:
    """Write a confidence with two digits, never rounded up: 0.797 is doubtful, and 0.80 is not."""
    return f"{math.floor(100 * confidence + 1e-9) / 100:.2f}"
