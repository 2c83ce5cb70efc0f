"""Measure the verdicts of ``inspect`` on photos whose blur is known.

The photos are those of `benchmark_shakes`: ``python scripts/benchmark_shakes.py --render-only``
renders them. The table has the true class in its rows and the verdict in its columns. The width and
the direction of a shake are compared with its path in the middle of the frame; a path nearly as
wide across as along has no direction.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from shake_cases import CASES, Case, case_file, homographies

from deshake.stages.inspecting import inspect_file

ROUND = 0.6  # standard deviation across over along; above it a path has no direction
LEAST = 1.2  # px: standard deviation of a path whose direction and width are compared
COLUMNS = ("sharp", "soft", "out of focus", "perhaps shaken", "shaken")


class Truth(NamedTuple):
    """A shake in the middle of the frame: extent along and across its axis (px), and the axis."""

    extent: float
    sigma: tuple[float, float]
    direction: float


def truth(folder: Path, case: Case) -> Truth | None:
    """Return the shake of a case; None: there is none."""
    if not case.shaken:
        return None
    record = json.loads(case_file(folder, case, ".json").read_text("utf-8"))
    height, width = record["shape"]
    with np.load(case_file(folder, case, "_path.npz")) as path:
        ways = homographies(path["theta"], float(path["f"]), height, width)
    middle = np.array([width / 2, height / 2, 1])
    place = ways @ middle
    place = place[:, :2] / place[:, 2:]
    values, axes = np.linalg.eigh(np.cov(place.T))
    along = axes[:, 1]
    extent = float(np.ptp(place @ along))
    sigma = math.sqrt(max(values[1], 0)), math.sqrt(max(values[0], 0))
    return Truth(extent, sigma, -math.degrees(math.atan2(along[1], along[0])) % 180)


def main() -> None:
    """Inspect the photos of a set, and print a line for each and the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="where benchmark_shakes has its cases")
    parser.add_argument("--set", choices=CASES, default="tune", help="default: %(default)s")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    table: Counter[tuple[str, str]] = Counter()
    widths, turns, seconds = [], [], []
    for case in CASES[args.set]:
        start = time.process_time()
        figures = inspect_file(args.folder / case.photo)
        seconds.append(time.process_time() - start)
        verdict = figures["verdict"]
        if verdict == "shaken" and not figures["certain"]:
            verdict = "perhaps shaken"
        kind = "shaken" if case.shaken else case.kind
        table[kind, verdict] += 1
        line = f"{case.name} {kind:12} {verdict:14} {seconds[-1]:5.2f} s"
        known = truth(args.folder, case)
        if "width_px" in figures:
            line += f"  {figures['width_px']:5.1f} px at {figures['direction']:3.0f}"
        if known is not None:
            line += f"  (true: {known.extent:.1f} px at {known.direction:.0f})"
            if "width_px" in figures and known.sigma[0] >= LEAST:
                widths.append(figures["width_px"] / known.extent)
                if known.sigma[1] <= ROUND * known.sigma[0]:
                    turn = abs(figures["direction"] - known.direction) % 180
                    turns.append(min(turn, 180 - turn))
        print(line, flush=True)
    print("\n| photo | " + " | ".join(COLUMNS) + " |\n|---" * 1 + "|" + "---|" * len(COLUMNS))
    for kind in ("sharp", "soft", "out of focus", "shaken"):
        print(f"| {kind} | " + " | ".join(str(table[kind, column]) for column in COLUMNS) + " |")
    low, middle, high = np.quantile(widths, (0.1, 0.5, 0.9))
    print(f"\nwidth over the true one, {len(widths)} shakes: median {middle:.2f}, ", end="")
    print(f"80 % of them {low:.2f} to {high:.2f}")
    print(f"direction, {len(turns)} shakes: median {np.median(turns):.0f} degrees off, ", end="")
    print(f"{np.mean(np.array(turns) <= 20):.0%} within 20")
    print(f"processor seconds: median {np.median(seconds):.2f}, most {max(seconds):.2f}")


if __name__ == "__main__":
    main()
