"""Measure the cost of a blurred and a noisy photo: time and memory of each stage, and of kernels.

    python scripts/benchmark_pair_cost.py [--megapixels 12] [--extent 40] [--threads 2]
    python scripts/benchmark_pair_cost.py --rotations 300 3000 20000 --megapixels

The blurred photos are those of `benchmark_cost`: mosaics of a photo in colour that a development
dependency ships, blurred along a random path about all three axes. The other is the mosaic itself
with noise, a sixteenth as bright and in the same frame, which is searched for all the same. Stages
run one after the other in a process of their own. Memory is the peak of this process by the end of
the stage, with its libraries and both photos.

The second table is Eq. (12) for a whole cube of so many rotations on a photo of 1000 px: rows of
B_N and least squares over the simplex, nothing carried over from a coarser scale.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
from math import ceil
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from benchmark_cost import BYTES, Case, alone, mosaic

from deshake.files.kernel_file import CameraFile
from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.formats.transfer import LINEAR
from deshake.geometry.rotations import grid_steps
from deshake.metadata.metadata import Metadata
from deshake.operators.filter_flow import FilterFlow
from deshake.pair.pair_pixels import PairPictures, derivatives, drawn_pixels, usable_pixels
from deshake.pair.pair_rows import PairRows
from deshake.pair.simplex import least_on_simplex
from deshake.run import Run, available_threads
from deshake.signal.noise import mean_light
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.deblurring import deblur
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.methods import RestorationOptions
from deshake.stages.pair_estimate import estimate_pair
from deshake.stages.registering import find_registration

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel
    from deshake.restore.sparse_gradients import Quality

    Image = NDArray[np.float32]

RATIO = np.float32(16)  # of the exposures
SIGMA = np.float32(0.05)  # of the noise, once the short exposure is as bright as the long one
ROTATIONS = 300
SOLVED = (300, 3000, 20_000)
SOLVED_MEGAPIXELS = 2 / 3  # 1000 px wide
SOLVED_EXTENT = 20.0
RIDGE = 0.01


class Stage(NamedTuple):
    """What a stage took."""

    name: str
    seconds: float
    cpu: float
    peak_gb: float

    def line(self) -> str:
        """Return a line of the table."""
        return f"| {self.name} | {self.seconds:.1f} | {self.cpu:.1f} | {self.peak_gb:.2f} |"


def photo(light: Image, file: Path) -> Photo:
    """Make a photo of linear light (h, w, 3) that claims to come from a file."""
    nothing = np.zeros(light.shape[:2], bool)
    coding = Encoding("TIFF", 16, grey=False, transfer=LINEAR)
    return Photo(light, nothing, None, coding, Metadata(), file)


def short_exposure(kernel: RotationKernel) -> Image:
    """Return the sharp mosaic that a kernel blurred, noisy and dark."""
    latent = FilterFlow(kernel.camera, kernel.theta, channels=3).latent_shape
    (height, width), (high, wide) = kernel.camera.shape, latent
    top, left = (high - height) // 2, (wide - width) // 2
    sharp = mosaic(latent)[top : top + height, left : left + width]
    noise = np.random.default_rng(1).standard_normal(sharp.shape, np.float32)
    return (sharp + SIGMA * noise) / RATIO


def stages(case: Case, file: Path, quality: Quality, threads: int) -> list[Stage]:
    """Take a pair through the stages of ``fix --noisy``."""
    kernel = case.kernel()
    blurred, noisy = photo(np.load(file), file), photo(short_exposure(kernel), file)
    options = EstimateOptions(camera=CameraChoice(file=CameraFile(kernel.camera, "the truth")))
    took = []

    def timed(name: str, work: Callable[[], Any]) -> Any:  # noqa: ANN401 - what the work gives
        start, start_cpu = time.perf_counter(), time.process_time()
        done = work()
        seconds, cpu = time.perf_counter() - start, time.process_time() - start_cpu
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * BYTES / 1e9
        took.append(Stage(name, seconds, cpu, peak))
        return done

    registering = timed(
        "register", lambda: find_registration(blurred, noisy, options, run=Run(threads))
    )
    known = {"registration": registering.registration, "run": Run(threads)}
    pair = timed("estimate-pair", lambda: estimate_pair(blurred, noisy, options, **known))
    how = RestorationOptions("fusion", quality=quality)
    timed(
        f"deblur --noisy, {pair.content.kernel.extent_px():.0f} px",
        lambda: deblur(blurred, pair.content.kernel, how, noisy=noisy, **known),
    )
    return took


def solved(case: Case, file: Path, count: str, threads: int) -> list[Stage]:
    """Solve Eq. (12) for a cube of at least so many rotations."""
    kernel = case.kernel()
    camera = kernel.camera
    g, f = mean_light(np.load(file)), mean_light(short_exposure(kernel) * RATIO)
    half = ceil((int(count) ** (1 / 3) - 1) / 2)
    side = np.arange(-half, half + 1)
    theta = np.stack(np.meshgrid(side, side, side, indexing="ij"), -1).reshape(-1, 3)
    theta = theta * grid_steps(camera)
    pictures = PairPictures.of(g, f, np.ones(camera.shape, np.float32), (), None)
    edges = derivatives(pictures.g)
    drawn = drawn_pixels(edges, usable_pixels(pictures, camera, theta), 0)
    start, start_cpu = time.perf_counter(), time.process_time()
    rows = PairRows(camera, theta, derivatives(pictures.f), edges, drawn.fitted, run=Run(threads))
    w = least_on_simplex(rows, np.ones(len(theta)), ridge=RIDGE)
    seconds, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * BYTES / 1e9
    return [Stage(f"{len(theta)}, {np.count_nonzero(w)} kept", seconds, cpu, peak)]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--megapixels", type=float, nargs="*", default=[12.0], metavar="M")
    parser.add_argument("--extent", type=float, default=40.0, metavar="PX", help="default: 40")
    parser.add_argument("--quality", choices=("fast", "default", "high"), default="default")
    parser.add_argument("--rotations", type=int, nargs="*", default=SOLVED, metavar="N")
    parser.add_argument("--threads", type=int, default=available_threads())
    args = parser.parse_args(argv)
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    head = "wall s | CPU s | peak GB |\n|---|---|---|---|"
    for megapixels in args.megapixels:
        print(f"{megapixels:g} megapixels, RGB, {args.threads} threads\n\n| stage | {head}")
        case = Case(megapixels, args.extent, ROTATIONS)
        for stage in alone(stages, case, args.quality, args.threads):
            print(stage.line(), flush=True)
        print()
    if args.rotations:
        print(f"Eq. (12), {args.threads} threads\n\n| rotations | {head}")
    for count in args.rotations:
        case = Case(SOLVED_MEGAPIXELS, SOLVED_EXTENT, ROTATIONS)
        for stage in alone(solved, case, str(count), args.threads):
            print(stage.line(), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
