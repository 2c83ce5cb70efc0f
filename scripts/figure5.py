"""Reproduce Fig. 5 of the paper: blind deblurring of single-axis blurs, in numbers.

    python scripts/figure5.py --data DIR                      the whole table
    python scripts/figure5.py --data DIR --cells Z20s0,Y20s0 --models R

DIR holds the authors' test photo, houses.jpg, of 320 x 240 pixels. Its values are taken as linear
light. The camera, f = 320 px, turns about Y or Z at uniform speed, sampled 250 times, as far as
blurs the edge of the frame by 10, 20 or 30 px. Noise of sigma 0, 5 or 10 of 255 is added, and the
photo is rounded to 8 bits and clipped. The rotational (R) and the uniform model (U) estimate a
kernel. As in the paper, they get the largest width of the blur, and use no prior on how hands turn
a camera. Richardson-Lucy, Eq. (11), deblurs with the estimated kernel and with the true one, by
equally many iterations.

Printed are root mean square errors, of 255, and in brackets their ratio to the true kernel's,
beside the paper's. Each is of the interior, with the sharp photo turned about three axes to where
it fits the restored one best: no blind method can know where the camera pointed on average.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.variational.estimate import estimate_variational
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps, homographies
from deshake.operators.warps import Warps
from deshake.restore.richardson_lucy import richardson_lucy
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Sequence

Image = NDArray[np.float32]

PHOTO = "houses.jpg"
SAMPLES = 250  # of the camera's path
ITERATIONS = 15  # of Eq. (11): the true kernel then scores about as in the paper
ROOM_PX = 2  # that the bound of the blur is wider than the blur
BORDER = 16  # px left out of the comparison on every side
AXES = "YZ"
EXTENTS = (10, 20, 30)  # px
SIGMAS = (0, 5, 10)  # of 255
MODELS = {"R": "rotational", "U": "uniform"}
FITS = (6.0, 3.0, 1.5, 0.0)  # px by which both photos are smoothed while they are aligned

# RMS error and its ratio to the true kernel's: 10, 20, 30 px.
PAPER = {
    ("Y", 0, "R"): ((23.1, 1.4), (27.2, 1.1), (32.2, 1.1)),
    ("Y", 5, "R"): ((24.9, 1.3), (29.0, 1.1), (33.4, 1.1)),
    ("Y", 10, "R"): ((27.0, 1.2), (30.7, 1.1), (41.9, 1.3)),
    ("Z", 0, "R"): ((14.4, 1.3), (18.1, 1.0), (25.4, 1.2)),
    ("Z", 5, "R"): ((17.4, 1.2), (23.2, 1.2), (30.6, 1.3)),
    ("Z", 10, "R"): ((22.0, 1.1), (26.5, 1.1), (30.0, 1.2)),
    ("Y", 0, "U"): ((23.2, 1.4), (58.1, 2.4), (129.3, 4.4)),
    ("Y", 5, "U"): ((25.8, 1.3), (56.8, 2.2), (62.9, 2.1)),
    ("Y", 10, "U"): ((30.1, 1.3), (48.7, 1.8), (57.8, 1.8)),
    ("Z", 0, "U"): ((21.8, 2.0), (26.1, 1.6), (57.6, 2.7)),
    ("Z", 5, "U"): ((24.8, 1.7), (54.5, 2.8), (58.6, 2.5)),
    ("Z", 10, "U"): ((50.9, 2.7), (55.8, 2.4), (57.5, 2.2)),
}


class Cell(NamedTuple):
    """One blur of the table: axis, extent in pixels, noise of 255."""

    axis: str
    extent: int
    sigma: int

    def __str__(self) -> str:
        """Name it as on the command line."""
        return f"{self.axis}{self.extent}s{self.sigma}"


CELLS = [Cell(axis, extent, sigma) for axis in AXES for sigma in SIGMAS for extent in EXTENTS]


class Score(NamedTuple):
    """RMS errors of 255 with the estimated kernel, the true one, and none; seconds it took."""

    estimated: float
    true: float
    blurred: float
    seconds: float


def parse_cells(text: str) -> list[Cell]:
    """Read names of cells such as ``Y10s0,Z30s5``."""
    cells = []
    for name in text.split(","):
        match = re.fullmatch(r"([YZ])(\d+)s(\d+)", name.strip())
        if not match:
            message = f"{name!r} is not a cell such as Y10s0"
            raise argparse.ArgumentTypeError(message)
        cells.append(Cell(match[1], int(match[2]), int(match[3])))
    return cells


def parse_models(text: str) -> list[str]:
    """Read names of models, ``R,U``."""
    models = [name.strip() for name in text.split(",")]
    if not set(models) <= set(MODELS):
        message = f"{text!r} is not R, U or R,U"
        raise argparse.ArgumentTypeError(message)
    return models


def shaken(sharp: Image, cell: Cell, seed: int) -> tuple[Image, RotationKernel]:
    """Blur a sharp photo, 0..255, as the paper does; return 8-bit values and the true kernel."""
    camera = Camera.from_focal(sharp.shape[1], *sharp.shape)
    turn = np.zeros(3)
    turn["XYZ".index(cell.axis)] = cell.extent
    path = np.linspace(-0.5, 0.5, SAMPLES)[:, None] * turn * grid_steps(camera)
    warps = Warps(camera, path)
    # the photo's edges go on for ever
    blurred = warps.blur(np.pad(sharp, warps.margin, mode="edge"), np.full(SAMPLES, 1 / SAMPLES))
    noise = cell.sigma * np.random.default_rng(seed).standard_normal(sharp.shape)
    photo = np.clip(np.round(blurred + noise), 0, 255).astype(np.float32)
    return photo, RotationKernel.from_path(path, camera)


def aligned_rms(restored: Image, sharp: Image) -> float:
    """RMS of the interior, the sharp photo turned to where it fits the restored one best.

    Gauss-Newton over the angles, with both photos smoothed less and less.
    """
    height, width = sharp.shape
    camera = Camera.from_focal(width, height, width)
    steps = grid_steps(camera)
    inner = (slice(BORDER, height - BORDER), slice(BORDER, width - BORDER))
    way = cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP

    def error(angles: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
        h = homographies(camera, angles * steps)
        turned = cv2.warpPerspective(
            sharp, h, (width, height), flags=way, borderMode=cv2.BORDER_REPLICATE
        )
        difference = turned - restored
        if sigma:
            difference = cv2.GaussianBlur(difference, (0, 0), sigma)
        return difference[inner].ravel().astype(np.float64)

    angles = np.zeros(3)
    for sigma in FITS:
        for _ in range(5):
            here = error(angles, sigma)
            probe = 0.1 * np.eye(3)
            jacobian = np.stack(
                [(error(angles + p, sigma) - error(angles - p, sigma)) / 0.2 for p in probe], 1
            )
            step = np.linalg.lstsq(jacobian, -here, rcond=None)[0]
            if np.linalg.norm(error(angles + step, sigma)) >= np.linalg.norm(here):
                break
            angles += step
    return float(np.sqrt((error(angles, 0.0) ** 2).mean()))


def score(sharp: Image, cell: Cell, model: str, seed: int) -> Score:
    """Shake the photo, estimate the kernel, and compare what the two kernels restore."""
    start = time.perf_counter()
    photo, true = shaken(sharp, cell, seed)
    light = photo / np.float32(255)
    blind_estimate = estimate_variational(
        light,
        true.camera,
        blur_px=cell.extent + ROOM_PX,
        uniform=model == "U",
        finest=True,
        roll_rate=0,
        run=Run(1),
    )

    def restored(kernel: RotationKernel) -> Image:
        done = richardson_lucy(light, kernel, iterations=ITERATIONS, accelerated=False, run=Run(1))
        clipped: Image = np.clip(done.pixels, 0, 1) * np.float32(255)
        return clipped

    return Score(
        aligned_rms(restored(blind_estimate.kernel), sharp),
        aligned_rms(restored(true), sharp),
        aligned_rms(photo, sharp),
        time.perf_counter() - start,
    )


def table(scores: dict[tuple[Cell, str], Score], model: str) -> str:
    """Write one model's part of the paper's table, in Markdown, beside the paper's numbers."""
    head = "".join(f" {extent} px | paper |" for extent in EXTENTS)
    lines = [f"| {MODELS[model]} |{head}", "|---|" + "---|" * (2 * len(EXTENTS))]
    for axis in AXES:
        for sigma in SIGMAS:
            line = f"| {axis}, sigma {sigma} |"
            for extent, (rms, ratio) in zip(EXTENTS, PAPER[axis, sigma, model], strict=True):
                scored = scores.get((Cell(axis, extent, sigma), model))
                ours = (
                    f"{scored.estimated:.1f} ({scored.estimated / scored.true:.2f})"
                    if scored
                    else ""
                )
                line += f" {ours} | {rms:.1f} ({ratio:.1f}) |"
            lines.append(line)
    return "\n".join(lines)


def run(sharp: Image, args: argparse.Namespace) -> dict[tuple[Cell, str], Score]:
    """Score all cells, some at once, and print each as it is done."""
    scores: dict[tuple[Cell, str], Score] = {}
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        works = {
            pool.submit(score, sharp, cell, model, args.seed): (cell, model)
            for model in args.models
            for cell in args.cells
        }
        for work in as_completed(works):
            cell, model = works[work]
            scores[cell, model] = scored = work.result()
            print(
                f"{cell} {model}: {scored.estimated:.2f} ({scored.estimated / scored.true:.3f}), "
                f"true kernel {scored.true:.2f}, blurred {scored.blurred:.2f}, "
                f"{scored.seconds:.0f} s",
                file=sys.stderr,
                flush=True,
            )
    return scores


def main(argv: Sequence[str] | None = None) -> int:
    """Run the protocol."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help=f"folder that holds {PHOTO}")
    parser.add_argument("--cells", type=parse_cells, default=CELLS, help="default: all 18")
    parser.add_argument("--models", type=parse_models, default=list(MODELS), help="default: R,U")
    parser.add_argument("--jobs", type=int, default=2, help="cells at once; default: 2")
    parser.add_argument("--seed", type=int, default=0, help="of the noise; default: 0")
    args = parser.parse_args(argv)
    path = args.data / PHOTO
    sharp = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
    if sharp is None:
        print(f"error: {path}: no such photo", file=sys.stderr)
        print("hint: --data names the folder of the authors' test photo", file=sys.stderr)
        return 1
    scores = run(sharp.astype(np.float32), args)
    for model in args.models:
        print(table(scores, model), end="\n\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
