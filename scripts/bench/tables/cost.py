"""How the time and the memory of deblurring, or of a blind estimate, grow.

    python scripts/bench.py cost [--quality fast] [--threads 2]
    python scripts/bench.py cost --at 1 15 100 --megapixels 0.5 1 --extents 15 --rotations 30
    python scripts/bench.py cost --of estimate [--estimator variational]
    python scripts/bench.py cost --fft              against its bare FFTs, at 12 megapixels

They grow with the photo, its blur, and the rotations of the kernel; one of the three varies at a
time. The photos are mosaics (`bench.cases.mosaics`), and need no data. Deblurring uses the default
method with the kernel that blurred the photo; the estimate uses the defaults and the true camera.
Each photo has a process of its own. Seconds are those of the work alone. Memory is the peak of the
whole process, with its libraries and the photo.

With --fft every forward, adjoint and inverse operator that the deblurring applies is counted, and
as many transforms there and back of the same blocks, by SciPy, are timed in the same process, by as
many threads, a few times before and after: the median counts. The transforms of the filters
themselves, once for each operator, are not counted.
"""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple
from unittest.mock import patch

import numpy as np

from bench.arguments import add_threads
from bench.cases.mosaics import Mosaic, alone
from bench.markdown import head, row
from bench.operator_ffts import bare_ffts
from bench.processes import Cost, measured
from deshake.blind.estimate import estimate_kernel
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.local_filters import LocalFilters
from deshake.operators.patch_inverse import PatchInverse
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run, available_threads
from deshake.signal.noise import mean_light

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    Image = NDArray[np.float32]

MEGAPIXELS = [1.0, 3.0, 6.0, 12.0, 24.0]
EXTENTS = [15.0, 30.0, 60.0, 120.0]
ROTATIONS = [30, 300, 3000]
AT = (6.0, 30.0, 300)
REPEATS = 3
OPERATORS = ((LocalFilters, "forward"), (LocalFilters, "adjoint"), (PatchInverse, "apply"))
WALL_CPU = ["wall s", "CPU s"]


class Result(NamedTuple):
    """What a mosaic took: its size, the true kernel's extent (px) and rotations, what came out."""

    shape: tuple[int, ...]
    extent: float
    rotations: int
    outcome: str
    cost: Cost

    def line(self) -> str:
        """Return a line of the table."""
        height, width, *_ = self.shape
        millions, cost = height * width / 1e6, self.cost
        size = [f"{millions:.2f}", f"{width} x {height}", f"{self.extent:.0f}", self.rotations]
        cells = [self.outcome, f"{cost.seconds:.1f}", f"{cost.cpu:.1f}"]
        return row([*size, *cells, f"{cost.cpu / millions:.2f}", f"{cost.peak_gb:.2f}"])


class Operator(NamedTuple):
    """An operator that was applied: its name, whether it is rough, and the planes it was given."""

    name: str
    rough: bool
    planes: int


class Share(NamedTuple):
    """What a deblurring took, how often it applied each operator, and what their bare FFTs take."""

    result: Result
    applied: dict[Operator, int]
    bare: float
    bare_cpu: float


HEAD = head(
    ["megapixels", "size", "extent, px", "rotations", "result", *WALL_CPU, "CPU s/MP", "peak GB"]
)


def deblur(mosaic: Mosaic, file: Path, quality: str, threads: int) -> Result:
    """Deblur the photo of a file, in a process that has done nothing else."""
    kernel, photo = mosaic.kernel(), np.load(file)
    work = partial(sparse_gradients, photo, kernel, quality=quality, run=Run(threads))
    _, cost = measured(work)
    return Result(photo.shape, kernel.extent_px(), len(kernel.weights), quality, cost)


def estimate(mosaic: Mosaic, file: Path, estimator: str, threads: int) -> Result:
    """Estimate the kernel of the photo of a file, in a process that has done nothing else."""
    kernel, grey = mosaic.kernel(), mean_light(np.load(file))
    result, cost = measured(
        partial(estimate_kernel, grey, kernel.camera, estimator=estimator, run=Run(threads))
    )
    outcome = f"{result.kernel.extent_px():.0f} px, {result.name}"
    return Result(grey.shape, kernel.extent_px(), len(kernel.weights), outcome, cost)


@contextmanager
def counted() -> Iterator[Counter[Operator]]:
    """Count the operators that are applied meanwhile."""
    counts: Counter[Operator] = Counter()

    def counting(name: str, method: Callable[..., Image]) -> Callable[..., Image]:
        def applied(self: LocalFilters | PatchInverse, planes: Image, *args: Any) -> Image:  # noqa: ANN401
            grid = (self.filters if isinstance(self, PatchInverse) else self).grid
            counts[Operator(name, grid.ramp < grid.hop, len(planes))] += 1
            return method(self, planes, *args)

        return applied

    with ExitStack() as stack:
        for owner, name in OPERATORS:
            stack.enter_context(patch.object(owner, name, counting(name, getattr(owner, name))))
        yield counts


def deblur_counted(mosaic: Mosaic, file: Path, quality: str, threads: int) -> Share:
    """Deblur as `deblur` does, and time the bare FFTs of all operators that it applies."""
    kernel = mosaic.kernel().centred()
    kinds = product((False, True), (1, 3))  # exact and rough, of one plane and of three
    took: dict[tuple[bool, int], list[tuple[float, float]]] = {kind: [] for kind in kinds}

    def time_ffts() -> None:
        for (rough, channels), times in took.items():
            flow = FilterFlow(
                kernel.camera, kernel.theta, rough=rough, channels=channels, run=Run(threads)
            )
            run = bare_ffts(flow, channels)
            run()  # the first run fills caches
            times.extend(measured(run)[1][:2] for _ in range(REPEATS))

    time_ffts()
    with counted() as applied:
        result = deblur(mosaic, file, quality, threads)
    time_ffts()
    bare, bare_cpu = sum(
        count * np.median(took[operator.rough, operator.planes], axis=0)
        for operator, count in applied.items()
    )
    return Share(result, dict(applied), float(bare), float(bare_cpu))


def print_share(share: Share) -> None:
    """Print the deblurring and its bare FFTs."""
    cost = share.result.cost
    print(f"{HEAD}\n{share.result.line()}\n\n{head(['operator', 'filters', 'planes', 'times'])}")
    for operator, count in sorted(share.applied.items()):
        filters = "rough" if operator.rough else "exact"
        print(row([operator.name, filters, operator.planes, count]))
    print("\n" + head(["", *WALL_CPU]))
    print(row(["deblurring", f"{cost.seconds:.1f}", f"{cost.cpu:.1f}"]))
    print(row(["its bare FFTs", f"{share.bare:.1f}", f"{share.bare_cpu:.1f}"]))
    print(row(["ratio", f"{cost.seconds / share.bare:.2f}", f"{cost.cpu / share.bare_cpu:.2f}"]))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--of", choices=("deblur", "estimate"), default="deblur", dest="stage")
    parser.add_argument("--megapixels", type=float, nargs="*", default=MEGAPIXELS, metavar="M")
    parser.add_argument("--extents", type=float, nargs="*", default=EXTENTS, metavar="PX")
    parser.add_argument(
        "--rotations",
        type=int,
        nargs="*",
        metavar="N",
        help="default: 30 300 3000, or none for an estimate, which does not know them",
    )
    parser.add_argument(
        "--at",
        type=float,
        nargs=3,
        default=AT,
        metavar=("M", "PX", "N"),
        help="values of the two that do not vary; default: 6 30 300",
    )
    parser.add_argument("--quality", choices=("fast", "default", "high"), default="default")
    parser.add_argument("--estimator", choices=("edges", "variational"), default="edges")
    add_threads(parser, available_threads())
    parser.add_argument(
        "--fft",
        type=float,
        nargs="?",
        const=12.0,
        metavar="M",
        help="instead: the ratio of deblurring to its bare FFTs, at M megapixels; default: 12",
    )


def run(args: argparse.Namespace) -> int:
    """Measure, and print the tables."""
    if args.fft is not None:
        args.stage = "deblur"
    if args.rotations is None:
        args.rotations = ROTATIONS if args.stage == "deblur" else []
    base = Mosaic(args.at[0], args.at[1], int(args.at[2]))
    work, how = (deblur, args.quality) if args.stage == "deblur" else (estimate, args.estimator)
    print(f"{args.stage}, {how}, RGB, {args.threads} threads\n", flush=True)
    if args.fft is not None:
        mosaic = base._replace(megapixels=args.fft)
        print_share(alone(deblur_counted, mosaic, args.quality, args.threads))
        return 0
    result_of = cache(partial(alone, work, how=how, threads=args.threads))
    for title, mosaics in {
        "by megapixels": [base._replace(megapixels=size) for size in args.megapixels],
        "by extent of the blur": [base._replace(extent=extent) for extent in args.extents],
        "by number of rotations": [base._replace(rotations=count) for count in args.rotations],
    }.items():
        if mosaics:
            print(f"{title}\n\n{HEAD}", flush=True)
            for mosaic in mosaics:
                print(result_of(mosaic).line(), flush=True)
            print()
    return 0
