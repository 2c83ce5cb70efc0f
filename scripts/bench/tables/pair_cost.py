"""Measure the cost of a blurred and a noisy photo: time and memory of each stage, and of kernels.

    python scripts/bench.py pair-cost [--megapixels 12] [--extent 40] [--threads 2]
    python scripts/bench.py pair-cost --rotations 300 3000 20000 --megapixels

The blurred photos are mosaics (`bench.cases.mosaics`). The other one is the mosaic itself with
noise, a sixteenth as bright and in the same frame, which the registration does not know. Stages run
one after the other in a process of their own. Memory is the peak of this process by the end of the
stage, with its libraries and both photos.

The second table is Eq. (12) for a whole cube of so many rotations on a photo of 1000 px: rows of
B_N and least squares over the simplex, nothing carried over from a coarser scale.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.arguments import add_threads
from bench.cases.mosaics import RATIO, Mosaic, alone, short_exposure
from bench.markdown import head, row
from bench.processes import Cost, measured
from deshake.files.kernel_file import CameraFile
from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.formats.transfer import LINEAR
from deshake.geometry.rotations import grid_steps
from deshake.metadata.metadata import Metadata
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
    import argparse
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from deshake.restore.sparse_gradients import Quality

    Image = NDArray[np.float32]

ROTATIONS = 300
SOLVED = (300, 3000, 20_000)
SOLVED_MEGAPIXELS = 2 / 3  # 1000 px wide
SOLVED_EXTENT = 20.0
RIDGE = 0.01


def photo(light: Image, file: Path) -> Photo:
    """Make a photo of linear light (h, w, 3) that claims to come from a file."""
    nothing = np.zeros(light.shape[:2], bool)
    coding = Encoding("TIFF", 16, grey=False, transfer=LINEAR)
    return Photo(light, nothing, None, coding, Metadata(), file)


def stages(mosaic: Mosaic, file: Path, quality: Quality, threads: int) -> list[tuple[str, Cost]]:
    """Take a pair through the stages of ``fix --noisy``."""
    kernel = mosaic.kernel()
    blurred, noisy = photo(np.load(file), file), photo(short_exposure(kernel), file)
    options = EstimateOptions(camera=CameraChoice(file=CameraFile(kernel.camera, "the truth")))
    took = []

    def timed(name: str, work: Callable[[], Any]) -> Any:  # noqa: ANN401 - what the work gives
        result, cost = measured(work)
        took.append((name, cost))
        return result

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


def solved(mosaic: Mosaic, file: Path, count: str, threads: int) -> list[tuple[str, Cost]]:
    """Solve Eq. (12) for a cube of at least so many rotations."""
    kernel = mosaic.kernel()
    camera = kernel.camera
    g, f = mean_light(np.load(file)), mean_light(short_exposure(kernel) * RATIO)
    half = ceil((int(count) ** (1 / 3) - 1) / 2)
    side = np.arange(-half, half + 1)
    theta = np.stack(np.meshgrid(side, side, side, indexing="ij"), -1).reshape(-1, 3)
    theta = theta * grid_steps(camera)
    pictures = PairPictures.of(g, f, np.ones(camera.shape, np.float32), (), None)
    edges = derivatives(pictures.g)
    drawn = drawn_pixels(edges, usable_pixels(pictures, camera, theta), 0)

    def solve() -> NDArray[np.float64]:
        f_edges = derivatives(pictures.f)
        rows = PairRows(camera, theta, f_edges, edges, drawn.fitted, run=Run(threads))
        return least_on_simplex(rows, np.ones(len(theta)), ridge=RIDGE)

    w, cost = measured(solve)
    return [(f"{len(theta)}, {np.count_nonzero(w)} kept", cost)]


def line(name: str, cost: Cost) -> str:
    """Return a line of a table."""
    return row([name, f"{cost.seconds:.1f}", f"{cost.cpu:.1f}", f"{cost.peak_gb:.2f}"])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--megapixels", type=float, nargs="*", default=[12.0], metavar="M")
    parser.add_argument("--extent", type=float, default=40.0, metavar="PX", help="default: 40")
    parser.add_argument("--quality", choices=("fast", "default", "high"), default="default")
    parser.add_argument("--rotations", type=int, nargs="*", default=SOLVED, metavar="N")
    add_threads(parser, available_threads())


def run(args: argparse.Namespace) -> int:
    """Measure, and print both tables."""
    costs = ["wall s", "CPU s", "peak GB"]
    for megapixels in args.megapixels:
        print(
            f"{megapixels:g} megapixels, RGB, {args.threads} threads\n\n{head(['stage', *costs])}"
        )
        mosaic = Mosaic(megapixels, args.extent, ROTATIONS)
        for stage in alone(stages, mosaic, args.quality, args.threads):
            print(line(*stage), flush=True)
        print()
    if args.rotations:
        print(f"Eq. (12), {args.threads} threads\n\n{head(['rotations', *costs])}")
    for count in args.rotations:
        mosaic = Mosaic(SOLVED_MEGAPIXELS, SOLVED_EXTENT, ROTATIONS)
        for stage in alone(solved, mosaic, str(count), args.threads):
            print(line(*stage), flush=True)
    return 0
