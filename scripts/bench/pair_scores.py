"""Scores of deblurring with the help of a noisy photo: a table and its summary."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bench.markdown import head, row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bench.metrics import Score

__all__ = ["PairResult", "header", "line", "summary"]

COLUMNS = ("blurred", "noisy", "denoised", "single", "blind", "uniform", "residual", "stopped")
COLUMNS += ("fusion", "true")
WIDTH = 1000  # px: width of the photos that the registration's error refers to


class PairResult(NamedTuple):
    """A case: how far off, the frame and the blur (px), confidences, scores, processor seconds."""

    off: float
    width: int
    extent: float
    registered: float
    confidence: float
    scores: dict[str, Score]
    seconds: dict[str, float]


def line(name: str, result: PairResult) -> str:
    """One case of the table."""
    cells = [name, f"{result.off:.2f}", f"{result.registered:.2f}", f"{result.confidence:.2f}"]
    return row(cells + [str(result.scores[what]) for what in COLUMNS if what in result.scores])


def header(*, blindly: bool, ways: Sequence[str]) -> str:
    """Head of the table."""
    cells = ["case", "off", "sure", "kernel"]
    there = {"blurred", "noisy", "denoised", *ways} | ({"blind"} if blindly else set())
    return head(cells + [what for what in COLUMNS if what in there])


def summary(results: dict[str, PairResult]) -> str:
    """Medians, means and least margins."""
    table = list(results.values())
    off = np.array([result.off * WIDTH / result.width for result in table])
    shares = np.array([result.off / result.extent for result in table])
    sure = min(result.registered for result in table)
    text = (
        f"registration: median {np.median(off):.2f} px of {WIDTH}, worst {off.max():.2f}; "
        f"worst {shares.max():.2f} of the blur, {(shares > 0.25).sum()} beyond a quarter; least "
        f"confidence {sure:.2f}"
    )
    lines = [text]

    def margins(ours: str, other: str) -> NDArray[np.float64]:
        return np.array(
            [np.subtract(result.scores[ours][:2], result.scores[other][:2]) for result in table]
        )

    loss = margins("true", "fusion")[:, 0]
    lines.append(
        f"kernel: loss against the true one median {np.median(loss):.2f} dB, mean {loss.mean():.2f}"
        f", worst {loss.max():.2f}"
    )
    others = [(other, "") for other in COLUMNS if other not in {"fusion", "true"}]
    for other, where in [*others, ("denoised", ", overlap")]:
        if f"{other}{where}" in table[0].scores:
            leads = margins(f"fusion{where}", f"{other}{where}")
            (p, s), (least_p, least_s) = leads.mean(0), leads.min(0)
            name = list(results)[int(leads[:, 0].argmin())]
            lines.append(
                f"fusion over {other}{where}: mean {p:+.2f} dB, {s:+.3f}; least {least_p:+.2f} "
                f"({name}), {least_s:+.3f}; better in {(leads > 0).all(1).sum()} of {len(table)}"
            )
    spent = {what: np.mean([result.seconds[what] for result in table]) for what in table[0].seconds}
    lines.append("seconds: " + ", ".join(f"{what} {mean:.1f}" for what, mean in spent.items()))
    return "\n".join(lines)
