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

_EVEN = -4.8  # log odds: the constant term
_OF_MARGIN = 25.0  # log odds per unit of margin
_LEAST_MARGIN, _MOST_MARGIN = -0.04, 0.12  # margin; values beyond count as these
_OF_AGREEMENT = 1.1  # log odds per power of ten by which the agreement comes nearer to one
_CLOSEST = 0.005  # agreement: smallest difference from one that can be measured
_OF_WIDTH = 1.1  # log odds per doubling of the width
_NARROWEST, _EVEN_WIDTH, _WIDEST = 3.0, 10.0, 40.0  # px of the photo; widths beyond count as these
_OF_EVIDENCE = 7.6  # log odds per unit of evidence
_MOST_EVIDENCE = 0.4  # evidence; more of it counts as this, and less than none counts as none
"""The constants come from a logistic regression on 155 results for 35 photos of the benchmark's
tuning set; most photos have several, of different versions of the estimate. Margin, agreement and
width depend on the kernel. A sharp photo, or one from a soft lens, easily gives a kernel by chance,
and these three may speak for it. The evidence of a shake does not depend on the kernel."""


def confidence(ended: Finish, evidence: float) -> float:
    """Return the chance, 0..1, that the winner of a race improves the photo.

    Parameters
    ----------
    ended : Finish
        The result of the race.
    evidence : float
        The evidence of a shake in the photo, from `blur_kind.Measures`.

    """
    if ended.at_rest:
        return 0.0
    width = np.clip(ended.winner.kernel.extent_px(), _NARROWEST, _WIDEST)
    excess = (
        _EVEN
        + _OF_MARGIN * np.clip(ended.margin, _LEAST_MARGIN, _MOST_MARGIN)
        - _OF_AGREEMENT * np.log10(1 + _CLOSEST - min(ended.agreement, 1.0))
        + _OF_WIDTH * np.log2(width / _EVEN_WIDTH)
        + _OF_EVIDENCE * np.clip(evidence, 0, _MOST_EVIDENCE)
    )
    return float(1 / (1 + np.exp(-excess)))


def two_digits(confidence: float) -> str:
    """Write a confidence with two digits, never rounded up: 0.797 is doubtful, and 0.80 is not."""
    return f"{math.floor(100 * confidence + 1e-9) / 100:.2f}"
