"""Measure what a wrong focal length costs, on photos shaken by recorded hands, against the truth.

    python scripts/benchmark_focal.py --data DIR
    python scripts/benchmark_focal.py --data DIR --photos coffee --windows 1 --factors 0.5,1,2

DIR holds orientation logs of a hand-held phone (`hand_shakes`). `shaken_photos` describes how the
photos are shaken, in turn through a wide lens (27 mm-equivalent by its width) and a normal one (50
mm). They become 8-bit JPEGs. The kernel of each is estimated with the true focal length times each
factor, and deblurs the photo. The table has gains in PSNR (dB) of display values over the photo
itself, after the shift and turn that fit the truth best, and in brackets the log odds of the
kernel's confidence. `judged` is the gain of the factor whose kernel has the highest confidence:
`--focal auto` would choose it from these.
"""

from __future__ import annotations

import argparse
import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from arguments import names
from hand_shakes import find_logs
from shaken_photos import PHOTOS, aligned, display, psnr, shaken
from shaken_photos import Case as Shake

from deshake.blind.estimate import estimate_kernel
from deshake.errors import DeshakeError, EstimationError
from deshake.geometry.camera import Camera
from deshake.restore.dark_halos import without_dark_halos
from deshake.run import Run
from deshake.signal.luminance import luminance
from deshake.stages.methods import restore

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.geometry.kernel import RotationKernel

WIDTHS = (0.75, 1.39)  # true focal lengths, in turn: 27 and 50 mm on a frame 36 mm wide
FACTORS = (0.5, 0.7, 1.0, 1.4, 2.0)
SMALL = ("astronaut", "coffee", "china", "motorcycle")
EXTENTS = (10.0, 40.0)  # px
PHOTONS = 4000
QUALITY = 92
BORDER = 12  # px left out of the comparison on every side


class Case(NamedTuple):
    """A photo and the number of the path that shakes it."""

    photo: str
    window: int

    def shake(self, seed: int) -> Shake:
        """Return how the photo is shaken."""
        own = np.random.default_rng([seed, list(PHOTOS).index(self.photo), self.window])
        extent, number = float(own.uniform(*EXTENTS)), int(own.integers(1 << 30))
        return Shake(
            self.photo,
            extent,
            number,
            hand=True,
            photons=PHOTONS,
            quality=QUALITY,
            focal=WIDTHS[self.window % len(WIDTHS)],
        )


class Trial(NamedTuple):
    """The result of one focal length: the gain in dB, and the kernel's confidence."""

    gain: float
    confidence: float

    @property
    def log_odds(self) -> float:
        """Natural logarithm of the odds; infinite where the confidence is 0 or 1."""
        with np.errstate(divide="ignore"):
            return float(np.log(self.confidence) - np.log1p(-self.confidence))


class Scores(NamedTuple):
    """A case: the gain of the true kernel, the extent of its blur, and the trials in turn."""

    true: float
    extent: float
    trials: tuple[Trial, ...]

    @property
    def judged(self) -> int:
        """The trial of the highest confidence."""
        return int(np.argmax([trial.confidence for trial in self.trials]))


def score(case: Case, folder: Path, factors: Sequence[float], seed: int) -> Scores:
    """Shake a photo and estimate its kernel with each focal length."""
    pixels, clipped, true, _ = photo = shaken(case.shake(seed), find_logs(folder))
    grey, sharp = luminance(pixels), display(photo.sharp(true.centroid))
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    blurred = psnr(display(pixels)[inner], sharp[inner])

    def gain(kernel: RotationKernel) -> float:
        if not kernel.theta[kernel.weights > 0].any():
            return 0.0
        done = restore(pixels, kernel, clipped=clipped, run=Run(1))
        ours = display(without_dark_halos(done.pixels, pixels, kernel))
        return max(psnr(one[inner], sharp[inner]) for one in (ours, aligned(ours, sharp))) - blurred

    trials = []
    for factor in factors:
        camera = true.camera
        camera = Camera.from_focal(factor * camera.focal_px, camera.height, camera.width)
        try:
            kernel_estimate = estimate_kernel(grey, camera, clipped=clipped, run=Run(1))
        except EstimationError:
            trials.append(Trial(0.0, 0.0))
        else:
            trials.append(Trial(gain(kernel_estimate.kernel), kernel_estimate.confidence))
    return Scores(gain(true), true.extent_px(), tuple(trials))


def header(factors: Sequence[float]) -> str:
    """Head of the table."""
    cells = ["photo", "focal", "px", "true", *(f"x{factor:g}" for factor in factors), "judged"]
    return "| " + " | ".join(cells) + " |\n" + "|---" * len(cells) + "|"


def line(case: Case, scores: Scores, factors: Sequence[float]) -> str:
    """One case of the table; in brackets, the log odds of the confidence."""
    focal = 36 * WIDTHS[case.window % len(WIDTHS)]
    cells = [f"{case.photo} {case.window}", f"{focal:.0f} mm"]
    cells += [f"{scores.extent:.0f}", f"{scores.true:+.2f}"]
    cells += [f"{trial.gain:+.2f} ({trial.log_odds:.1f})" for trial in scores.trials]
    won = scores.judged
    cells.append(f"{scores.trials[won].gain:+.2f} (x{factors[won]:g})")
    return "| " + " | ".join(cells) + " |"


def summary(table: Sequence[Scores], factors: Sequence[float]) -> str:
    """Mean and worst loss against the true focal length, for each factor and the judged one."""
    right = factors.index(1.0)
    base = np.array([scores.trials[right].gain for scores in table])
    true = np.mean([scores.true for scores in table])
    lines = [f"true kernel {true:+.2f} dB on the mean, estimated at the true f {base.mean():+.2f}"]
    ways = {f"x{factor:g}": [scores.trials[k].gain for scores in table]
            for k, factor in enumerate(factors)}  # fmt: skip
    ways["judged"] = [scores.trials[scores.judged].gain for scores in table]
    for name, gains in ways.items():
        loss = np.array(gains) - base
        lines.append(
            f"{name}: {loss.mean():+.2f} dB on the mean, median {np.median(loss):+.2f}, "
            f"worst {loss.min():+.2f}"
        )
    taken = [factors[scores.judged] for scores in table]
    lines.append("the judge takes " + ", ".join(f"x{f:g} {taken.count(f)} times" for f in factors))
    return "\n".join(lines)


def numbers(text: str) -> list[float]:
    """Read factors, 1 among them, separated by commas."""
    factors = [float(part) for part in text.split(",")]
    if 1.0 not in factors or min(factors) <= 0:
        message = f"{text!r} is not a list of factors with 1 among them"
        raise argparse.ArgumentTypeError(message)
    return factors


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of orientation logs")
    photos = partial(names, known=tuple(PHOTOS))
    parser.add_argument("--photos", type=photos, default=SMALL, help="default: four small ones")
    parser.add_argument("--windows", type=int, default=2, help="paths for each; default: 2")
    parser.add_argument("--factors", type=numbers, default=FACTORS, help="default: 0.5 to 2")
    parser.add_argument("--seed", type=int, default=0, help="of paths and noise; default: 0")
    args = parser.parse_args(argv)
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        find_logs(args.data)
    except DeshakeError as error:
        print(f"error: {error}\nhint: {error.hint}", file=sys.stderr)
        return 1
    print(header(args.factors), flush=True)
    table = []
    for window in range(args.windows):
        for photo in args.photos:
            case = Case(photo, window)
            table.append(score(case, args.data, args.factors, args.seed))
            print(line(case, table[-1], args.factors), flush=True)
    print("\n" + summary(table, args.factors))
    return 0


if __name__ == "__main__":
    sys.exit(main())
