"""The confidence of a kernel: the chance that deblurring with it improves the photo."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.settings import SETTINGS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from deshake.blind.drawn_path import Drawing
    from deshake.blind.finish import Finish

__all__ = ["confidence", "drawn_confidence", "selected", "two_digits"]

_S: Final = SETTINGS.trust


def confidence(ended: Finish) -> float:
    """Return the chance, 0..1, that the winner of a race improves the photo."""
    if ended.at_rest:
        return 0.0
    log_odds = (
        _S.constant
        + _S.of_margin * np.clip(ended.margin, _S.least_margin, _S.most_margin)
        - _S.of_agreement * np.log10(1 + _S.closest - min(ended.agreement, 1.0))
        + _S.of_match * np.clip(ended.match, 0, _S.most_match)
    )
    if ended.lead is not None:
        lead = _S.of_lead * (ended.lead - _S.usual_lead)
        log_odds += np.clip(lead, _S.least_of_lead, _S.most_of_lead)
    return _chance(float(log_odds))


def selected(best: Iterable[Finish]) -> Finish:
    """Return the first result, or, if it is hopeless, the one with the highest confidence.

    The others are asked for only then.
    """
    others = iter(best)
    first = next(others)
    hopeless = confidence(first) < SETTINGS.course.hopeful
    return max([first, *others], key=confidence) if hopeless else first


def drawn_confidence(drawn: Drawing) -> float:
    """Return the chance, 0..1, that the path of the streaks improves the photo."""
    return _chance(_S.drawn - _S.of_misfit * drawn.misfit)


def _chance(log_odds: float) -> float:
    """Return the chance, 0..1, of something with these log odds."""
    return float(1 / (1 + np.exp(-log_odds)))


def two_digits(confidence: float) -> str:
    """Write a confidence with two digits, rounded down: 0.797 must not look like the limit 0.80."""
    return f"{math.floor(100 * confidence + 1e-9) / 100:.2f}"
