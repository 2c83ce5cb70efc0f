"""How the time and the memory of a blind estimate grow with the photo and its blur.

    python scripts/benchmark_estimation.py [--estimator variational] [--threads 2]
    python scripts/benchmark_estimation.py --at 1 15 --megapixels 0.25 1 --extents

One of the two varies at a time. The photos are those of `benchmark_cost`: mosaics of a photo in
colour that a development dependency ships, blurred along a random path about all three axes, with
white noise. The estimate of each kernel uses the defaults and the true camera, in a process of its
own. Seconds are those of the estimate alone. Memory is the peak of the whole process, with its
libraries and the photo.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from benchmark_cost import BYTES, Case, alone

from deshake.blind.estimate import estimate_kernel
from deshake.run import Run, available_threads
from deshake.signal.noise import mean_light

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

MEGAPIXELS = [0.25, 1.0, 4.0, 12.0, 24.0]
EXTENTS = [10.0, 20.0, 40.0, 80.0]
AT = (4.0, 20.0)
ROTATIONS = 300
HEAD = (
    "| megapixels | size | extent, px | estimated, px | candidate | wall s | CPU s | peak GB |\n"
    "|---|---|---|---|---|---|---|---|"
)


class Cost(NamedTuple):
    """The cost of an estimate, and the extents (px) of the true and the estimated kernel."""

    shape: tuple[int, int]
    extent: float
    estimated: float
    name: str
    seconds: float
    cpu: float
    peak_gb: float

    def line(self) -> str:
        """Return a line of the table."""
        height, width = self.shape
        cells = [f"{height * width / 1e6:.2f}", f"{width} x {height}", f"{self.extent:.0f}"]
        cells += [f"{self.estimated:.0f}", self.name, f"{self.seconds:.1f}", f"{self.cpu:.1f}"]
        return "| " + " | ".join([*cells, f"{self.peak_gb:.2f}"]) + " |"


def estimate(case: Case, file: Path, estimator: str, threads: int) -> Cost:
    """Estimate the kernel of the photo of a file, in a process that has done nothing else."""
    kernel, grey = case.kernel(), mean_light(np.load(file))
    start, start_cpu = time.perf_counter(), time.process_time()
    estimate_result = estimate_kernel(grey, kernel.camera, estimator=estimator, run=Run(threads))
    seconds, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * BYTES / 1e9
    extents = kernel.extent_px(), estimate_result.kernel.extent_px()
    return Cost(kernel.camera.shape, *extents, estimate_result.name, seconds, cpu, peak)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--megapixels", type=float, nargs="*", default=MEGAPIXELS, metavar="M")
    parser.add_argument("--extents", type=float, nargs="*", default=EXTENTS, metavar="PX")
    parser.add_argument(
        "--at",
        type=float,
        nargs=2,
        default=AT,
        metavar=("M", "PX"),
        help="value of the one that does not vary; default: 4 20",
    )
    parser.add_argument("--estimator", choices=("edges", "variational"), default="edges")
    parser.add_argument("--threads", type=int, default=available_threads())
    args = parser.parse_args(argv)
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    base = Case(*args.at, ROTATIONS)
    print(f"estimator {args.estimator}, {args.threads} threads\n", flush=True)
    measured = cache(partial(alone, estimate, how=args.estimator, threads=args.threads))
    for title, cases in {
        "by megapixels": [base._replace(megapixels=size) for size in args.megapixels],
        "by extent of the blur": [base._replace(extent=extent) for extent in args.extents],
    }.items():
        if cases:
            print(f"{title}\n\n{HEAD}", flush=True)
            for case in cases:
                print(measured(case).line(), flush=True)
            print()
    return 0


if __name__ == "__main__":
    sys.exit(main())
