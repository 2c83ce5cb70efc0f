"""How the time and the memory of deblurring grow with the photo, the blur and its rotations.

    python scripts/benchmark_cost.py [--quality fast] [--threads 2]
    python scripts/benchmark_cost.py --at 1 15 100 --megapixels 0.5 1 --extents 15 --rotations 30
    python scripts/benchmark_cost.py --fft               against its bare FFTs, at 12 megapixels

One of the three varies at a time. A photo in colour, a mosaic of one that a development dependency
ships, is blurred along a random path about all three axes and gets white noise; nothing clips. A
kernel has the rotations of the camera's grid that lie nearest to such a path, which is longer the
fewer they are, so that the extent is the same. Each photo is deblurred by the default method with
the kernel that blurred it, in a process of its own. Seconds are those of the deblurring alone.
Memory is the peak of the whole process, with its libraries and the photo.

With --fft every forward, adjoint and inverse operator that the deblurring applies is counted, and
as many transforms there and back of the same blocks, by SciPy, are timed in the same process, by as
many threads, a few times before and after: the median counts. The transforms of the filters
themselves, once for each operator, are not counted.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from unittest.mock import patch

import cv2
import numpy as np
from benchmark_operators import bare_ffts
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skimage import data

from deshake.formats.transfer import Srgb, decode
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.local_filters import LocalFilters
from deshake.operators.patch_inverse import PatchInverse
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run, available_threads
from deshake.simulation.shake_path import random_path

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Image = NDArray[np.float32]

MEGAPIXELS = [1.0, 3.0, 6.0, 12.0, 24.0]
EXTENTS = [15.0, 30.0, 60.0, 120.0]
ROTATIONS = [30, 300, 3000]
AT = (6.0, 30.0, 300)
SIGMA = 0.005
BRIGHTEST = np.float32(0.8)  # of the sharp scene, so that nothing clips
PATH_SAMPLES = 2000  # several in each step of the grid
REPEATS = 3
BYTES = 1 if sys.platform == "darwin" else 1024  # of a unit of ru_maxrss
OPERATORS = ((LocalFilters, "forward"), (LocalFilters, "adjoint"), (PatchInverse, "apply"))


class Case(NamedTuple):
    """Megapixels of the photo, pixels that its blur extends over, rotations of its kernel."""

    megapixels: float
    extent: float
    rotations: int

    def kernel(self) -> RotationKernel:
        """Make the kernel of equal weights, for a camera that takes photos of 3:2."""
        height = round((self.megapixels * 1e6 / 1.5) ** 0.5)
        width = round(1.5 * height)
        camera = Camera.from_focal(width, height, width)
        steps = grid_steps(camera)
        path = random_path(camera, self.extent, samples=PATH_SAMPLES).theta / steps
        for _ in range(5):
            passed = np.rint(path)
            near = RotationKernel.from_indices(passed, np.ones(len(path)), steps, camera)
            while len(near.weights) < self.rotations:
                near = near.dilated()
            away, _ = cKDTree(path).query(near.indices)
            nearest = near.indices[np.argsort(away, kind="stable")[: self.rotations]]
            kernel = RotationKernel.from_indices(nearest, np.ones(len(nearest)), steps, camera)
            path *= self.extent / kernel.extent_px()
        return kernel


class Cost(NamedTuple):
    """What a deblurring took, and the kernel that it really had."""

    shape: tuple[int, ...]
    extent: float
    rotations: int
    seconds: float
    cpu: float
    peak_gb: float


class Share(NamedTuple):
    """What a deblurring took, its operators by their planes, and what their bare FFTs take."""

    cost: Cost
    applied: dict[tuple[str, int], int]
    bare: float
    bare_cpu: float


def mosaic(shape: tuple[int, int]) -> Image:
    """Return the sharp scene (h, w, 3) in linear light."""
    tile = decode(data.astronaut(), Srgb()) * BRIGHTEST
    tile = cv2.resize(tile, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    more = [(0, max(side - n, 0)) for side, n in zip(shape, tile.shape, strict=False)]
    return np.pad(tile, [*more, (0, 0)], mode="symmetric")[: shape[0], : shape[1]]


def write_photo(case: Case, file: Path) -> None:
    """Blur a mosaic and write it as an array of linear light."""
    kernel = case.kernel()
    flow = FilterFlow(kernel.camera, kernel.theta, channels=3)
    photo = flow.blur(mosaic(flow.latent_shape), kernel.weights)
    noise = np.random.default_rng(0).standard_normal(photo.shape, np.float32)
    np.save(file, np.clip(photo + np.float32(SIGMA) * noise, 0, 1))


def deblur(case: Case, file: Path, quality: str, threads: int) -> Cost:
    """Deblur the photo of a file, in a process that has done nothing else."""
    kernel, photo = case.kernel(), np.load(file)
    start, start_cpu = time.perf_counter(), time.process_time()
    sparse_gradients(photo, kernel, quality=quality, run=Run(threads))
    seconds, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * BYTES / 1e9
    return Cost(photo.shape, kernel.extent_px(), len(kernel.weights), seconds, cpu, peak)


@contextmanager
def counted() -> Iterator[Counter[tuple[str, int]]]:
    """Count the operators that are applied meanwhile, by name and number of planes."""
    counts: Counter[tuple[str, int]] = Counter()

    def counting(name: str, method: Callable[..., Image]) -> Callable[..., Image]:
        def applied(self: object, planes: Image, *args: Any) -> Image:  # noqa: ANN401
            counts[name, len(planes)] += 1
            return method(self, planes, *args)

        return applied

    with ExitStack() as stack:
        for owner, name in OPERATORS:
            stack.enter_context(patch.object(owner, name, counting(name, getattr(owner, name))))
        yield counts


def deblur_counted(case: Case, file: Path, quality: str, threads: int) -> Share:
    """Deblur as `deblur` does, and time the bare FFTs of all operators that it applies."""
    kernel = case.kernel().centred()
    took: dict[int, list[tuple[float, float]]] = {1: [], 3: []}

    def time_ffts() -> None:
        for channels, times in took.items():
            flow = FilterFlow(kernel.camera, kernel.theta, channels=channels, run=Run(threads))
            run = bare_ffts(flow, channels)
            run()  # the first run fills caches
            for _ in range(REPEATS):
                start, start_cpu = time.perf_counter(), time.process_time()
                run()
                times.append((time.perf_counter() - start, time.process_time() - start_cpu))

    time_ffts()
    with counted() as applied:
        cost = deblur(case, file, quality, threads)
    time_ffts()
    bare, bare_cpu = sum(
        count * np.median(took[planes], axis=0) for (_, planes), count in applied.items()
    )
    return Share(cost, dict(applied), float(bare), float(bare_cpu))


def alone(work: Callable[..., Any], case: Case, how: str, threads: int) -> Any:  # noqa: ANN401
    """Make a photo in one new process and do some work on it in another."""
    spawn = get_context("spawn")
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(1, mp_context=spawn, max_tasks_per_child=1) as pool,
    ):
        file = Path(folder) / "photo.npy"
        pool.submit(write_photo, case, file).result()
        return pool.submit(work, case, file, how, threads).result()


def line(cost: Cost) -> str:
    """One case of the table."""
    height, width, _ = cost.shape
    millions = height * width / 1e6
    cells = [f"{millions:.1f}", f"{width} x {height}", f"{cost.extent:.0f}", f"{cost.rotations}"]
    cells += [f"{cost.seconds:.1f}", f"{cost.cpu:.1f}", f"{cost.cpu / millions:.2f}"]
    return "| " + " | ".join([*cells, f"{cost.peak_gb:.2f}"]) + " |"


HEAD = (
    "| megapixels | size | extent, px | rotations | wall s | CPU s | CPU s/MP | peak GB |\n"
    "|---|---|---|---|---|---|---|---|"
)


def print_share(share: Share) -> None:
    """Print the deblurring and its bare FFTs."""
    cost = share.cost
    print(f"{HEAD}\n{line(cost)}\n\n| operator | planes | times |\n|---|---|---|")
    for (name, planes), count in sorted(share.applied.items()):
        print(f"| {name} | {planes} | {count} |")
    print("\n| | wall s | CPU s |\n|---|---|---|")
    print(f"| deblurring | {cost.seconds:.1f} | {cost.cpu:.1f} |")
    print(f"| its bare FFTs | {share.bare:.1f} | {share.bare_cpu:.1f} |")
    print(f"| ratio | {cost.seconds / share.bare:.2f} | {cost.cpu / share.bare_cpu:.2f} |")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--megapixels", type=float, nargs="*", default=MEGAPIXELS, metavar="M")
    parser.add_argument("--extents", type=float, nargs="*", default=EXTENTS, metavar="PX")
    parser.add_argument("--rotations", type=int, nargs="*", default=ROTATIONS, metavar="N")
    parser.add_argument(
        "--at",
        type=float,
        nargs=3,
        default=AT,
        metavar=("M", "PX", "N"),
        help="values of the two that do not vary; default: 6 30 300",
    )
    parser.add_argument("--quality", choices=("fast", "default", "high"), default="default")
    parser.add_argument("--threads", type=int, default=available_threads())
    parser.add_argument(
        "--fft",
        type=float,
        nargs="?",
        const=12.0,
        metavar="M",
        help="instead: the ratio to the bare FFTs, at M megapixels; default: 12",
    )
    args = parser.parse_args(argv)
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    base = Case(args.at[0], args.at[1], int(args.at[2]))
    print(f"sparse, quality {args.quality}, RGB, {args.threads} threads\n", flush=True)
    if args.fft is not None:
        case = base._replace(megapixels=args.fft)
        print_share(alone(deblur_counted, case, args.quality, args.threads))
        return 0
    measured = cache(partial(alone, deblur, how=args.quality, run=Run(args.threads)))
    for title, cases in {
        "by megapixels": [base._replace(megapixels=size) for size in args.megapixels],
        "by extent of the blur": [base._replace(extent=extent) for extent in args.extents],
        "by number of rotations": [base._replace(rotations=count) for count in args.rotations],
    }.items():
        if cases:
            print(f"{title}\n\n{HEAD}", flush=True)
            for case in cases:
                print(line(measured(case)), flush=True)
            print()
    return 0


if __name__ == "__main__":
    sys.exit(main())
