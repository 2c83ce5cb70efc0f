"""Measure the verdicts of ``inspect`` on photos whose blur is known.

    python scripts/bench.py shakes --cases DIR --set test --render-only    # renders the photos
    python scripts/bench.py inspect --cases DIR --set test

The photos are those of `bench.cases.shakes`. The table has the true class in its rows and the
verdict in its columns. The width and the direction of a shake are compared with its path in the
middle of the frame; a path nearly as wide across as along has no direction.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from bench.cases.camera_paths import homographies
from bench.cases.rendering import is_rendered
from bench.cases.shakes import CASES, KINDS, Case, case_file
from bench.errors import MissingDataError
from bench.markdown import head, row
from bench.processes import measured
from deshake.stages.inspecting import inspect_file

if TYPE_CHECKING:
    import argparse

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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--cases", type=Path, required=True, metavar="DIR", help="folder of rendered cases"
    )
    parser.add_argument("--set", choices=CASES, default="tune", help="default: %(default)s")


def run(args: argparse.Namespace) -> int:
    """Inspect the photos of a set, and print a line for each and the tables."""
    cv2.setNumThreads(1)
    missing = [case.name for case in CASES[args.set] if not is_rendered(case, args.cases)]
    if missing:
        raise MissingDataError(
            f"{len(missing)} cases are not rendered, {missing[0]} among them; --cases names their "
            "folder, and `bench.py shakes --render-only` renders them"
        )
    table: Counter[tuple[str, str]] = Counter()
    widths, turns, seconds = [], [], []
    for case in CASES[args.set]:
        figures, cost = measured(partial(inspect_file, args.cases / case.photo))
        seconds.append(cost.cpu)
        verdict = figures["verdict"]
        if verdict == "shaken" and not figures["certain"]:
            verdict = "perhaps shaken"
        kind = "shaken" if case.shaken else case.kind
        table[kind, verdict] += 1
        line = f"{case.name} {kind:12} {verdict:14} {seconds[-1]:5.2f} s"
        known = truth(args.cases, case)
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
    print("\n" + head(["photo", *COLUMNS]))
    seen = {kind for kind, _ in table}
    for kind in (*(kind for kind in KINDS.values() if kind in seen), "shaken"):
        print(row([kind, *(table[kind, column] for column in COLUMNS)]))
    low, middle, high = np.quantile(widths, (0.1, 0.5, 0.9))
    print(f"\nwidth over the true one, {len(widths)} shakes: median {middle:.2f}, ", end="")
    print(f"80 % of them {low:.2f} to {high:.2f}")
    print(f"direction, {len(turns)} shakes: median {np.median(turns):.0f} degrees off, ", end="")
    print(f"{np.mean(np.array(turns) <= 20):.0%} within 20")
    print(f"processor seconds: median {np.median(seconds):.2f}, most {max(seconds):.2f}")
    return 0
