"""The results of `bench.py shakes`: a line a case, and tables by class and by confidence."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bench.cases.shakes import KINDS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

__all__ = ["COLUMNS", "Row", "dump", "line", "number", "report"]

WORSE = 0.1  # dB
SURE = 0.5
BINS = (0, 0.1, 0.5, 0.9, 1.0001)
WORST = 8  # cases listed
COLUMNS = (
    "case  class         MP    px  | photo  result   true    gain  below | alike  extent px"
    "   | conf.  CPU s     MB  verdict"
)


@dataclass(frozen=True)
class Row:
    """The result of a case; PSNR in dB, CPU seconds and megabytes of the estimate."""

    name: str
    kind: str
    scene: str
    megapixels: float
    blur: float
    photo: float
    result: float
    true: float | None
    alike: float | None
    extent: float | None
    true_extent: float | None
    confidence: float
    seconds: float
    megabytes: float
    verdict: str
    notes: list[str] = field(default_factory=list)

    @property
    def gain(self) -> float:
        """The result's lead on the photo."""
        return self.result - self.photo

    @property
    def below(self) -> float | None:
        """The true kernel's lead on the result."""
        return None if self.true is None else self.true - self.result

    @property
    def deblurred(self) -> bool:
        """Whether the photo was changed."""
        return self.verdict == "deblurred"

    @property
    def warned(self) -> bool:
        """Whether the user is warned not to trust the result."""
        return self.confidence < SURE or any("doubtful" in note for note in self.notes)


def number(value: float | None, form: str) -> str:
    """Format a number, or a dash in its place."""
    width = int(form.split(".", maxsplit=1)[0].lstrip("+"))
    return "-".rjust(width) if value is None else format(value, form)


def line(row: Row) -> str:
    """One case."""
    extent = f"{number(row.extent, '5.1f')} /{number(row.true_extent, '6.1f')}"
    remark = row.notes[0][:60] if row.notes and row.true is None else ""
    verdict = row.verdict + (", warned" if row.warned and row.deblurred else "")
    return (
        f"{row.name:5} {row.kind:12} {row.megapixels:5.2f} {row.blur:5.1f}"
        f"  | {row.photo:5.2f}  {row.result:6.2f}  {number(row.true, '5.2f')}"
        f"  {row.gain:+6.2f}  {number(row.below, '5.2f')} | {number(row.alike, '5.3f')}"
        f"  {extent}  | {row.confidence:5.3f}  {row.seconds:5.1f}  {row.megabytes:5.0f}"
        f"  {verdict}{'; ' if remark else ''}{remark}"
    )


def spread(values: Sequence[float], form: str, worst: Callable[[Sequence[float]], float]) -> str:
    """Mean, median and worst."""
    return " ".join(
        format(one, form) for one in (np.mean(values), np.median(values), worst(values))
    )


def class_table(rows: Sequence[Row]) -> list[str]:
    """Gain, distance from the true kernel and cost of each class."""
    head = (
        f"{'class':13} {'n':>3} {'left':>4} |{'gain: mean, median, worst':>26} |"
        f"{'below: mean, median, worst':>27} |{'CPU: mean, median, worst':>26}"
    )
    lines = [head]
    for kind in KINDS.values():
        some = [row for row in rows if row.kind == kind]
        if not some:
            continue
        below = [row.below for row in some if row.below is not None]
        lines.append(
            f"{kind:13} {len(some):3} {sum(not row.deblurred for row in some):4} |"
            f" {spread([row.gain for row in some], '+7.2f', min):>25} |"
            f" {spread(below, '7.2f', max) if below else '-':>26} |"
            f" {spread([row.seconds for row in some], '7.1f', max):>25}"
        )
    return lines


def unwarned_table(rows: Sequence[Row]) -> list[str]:
    """Count the photos that become worse without a warning."""
    lines = [f"made worse by more than {WORSE} dB without a warning:"]
    for kind in KINDS.values():
        some = [row for row in rows if row.kind == kind]
        worse = [row.name for row in some if row.gain < -WORSE and not row.warned]
        if some:
            lines.append(f"  {kind:13} {len(worse)} of {len(some)}  {' '.join(worse)}")
    return lines


def reliability_table(rows: Sequence[Row]) -> list[str]:
    """Compare the confidence of results with how many of them are better than their photos."""
    lines = ["confidence  deblurred, shaken: better   deblurred, not shaken: better"]
    for low, high in pairwise(BINS):
        cells = []
        for shaken in (True, False):
            some = [
                row
                for row in rows
                if row.deblurred
                and low <= row.confidence < high
                and (row.true is not None) == shaken
            ]
            better = sum(row.gain > 0 for row in some)
            share = f"{100 * better / len(some):4.0f} %" if some else "     -"
            cells.append(f"{len(some):18} {share:>8}")
        lines.append(f"{low:3.1f} to {min(high, 1):3.1f} {'    '.join(cells)}")
    return lines


def worst_cases(rows: Sequence[Row]) -> list[str]:
    """List the smallest gains, and the largest distances from the true kernel."""
    by_gain = sorted(rows, key=lambda row: row.gain)[:WORST]
    shaken = [row for row in rows if row.below is not None]
    by_distance = sorted(shaken, key=lambda row: -(row.below or 0))[:WORST]
    return [
        "smallest gains: " + ", ".join(f"{row.name} {row.gain:+.2f}" for row in by_gain),
        "farthest below the true kernel: "
        + ", ".join(f"{row.name} {row.below:.2f}" for row in by_distance),
    ]


def report(rows: Sequence[Row]) -> str:
    """All tables."""
    tables = (class_table, unwarned_table, reliability_table, worst_cases)
    return "\n\n".join("\n".join(table(rows)) for table in tables)


def dump(rows: Sequence[Row], file: Path) -> None:
    """Write all rows as JSON."""
    records = [asdict(row) | {"gain": row.gain, "below": row.below} for row in rows]
    file.write_text(json.dumps(records, indent=1) + "\n", "utf-8")
