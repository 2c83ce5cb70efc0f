"""What a wrong focal length costs, on photos shaken by recorded hands, with the truth in hand.

    python scripts/benchmark_focal.py --data DIR
    python scripts/benchmark_focal.py --data DIR --photos coffee --windows 1 --factors 0.5,1,2

The photos are shaken as by `benchmark_blind`, every other one through a wide lens (27 mm-equivalent
by its width) and through a normal one (50 mm). The kernel of each is estimated with the true focal
length times each factor, and the photo deblurred with it. Printed are gains in PSNR (dB) of display
values over the photo as it is, after the shift and turn that fit the truth best, and how much the
judge of the estimates, which does not know the truth, finds the kernel better than no shake at all.
`judged` is the gain of the factor that the judge finds best: what choosing the focal length by it
would give.
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
from benchmark_blind import (
    PHOTOS,
    RESTORATIONS,
    Case,
    aligned_psnr,
    display,
    psnr,
    read,
    shake,
)
from hand_shakes import find_logs

from deshake.deconvolution.dark_halos import without_dark_halos
from deshake.deconvolution.methods import restore
from deshake.errors import DeshakeError, EstimationError
from deshake.estimation import judge
from deshake.estimation.candidates import JUDGE_SIDE, reduced
from deshake.estimation.methods import estimate_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.io.transfer import Srgb, decode, is_clipped
from deshake.pipelines.stages import luminance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

WIDTHS = (0.75, 1.39)  # true focal lengths, in turn: 27 and 50 mm on a frame 36 mm wide
FACTORS = (0.5, 0.7, 1.0, 1.4, 2.0)
SMALL = ("astronaut", "coffee", "china", "motorcycle")


class Trial(NamedTuple):
    """What came of one focal length: the gain in dB, and the judge's margin over no shake."""

    gain: float
    margin: float


class Scores(NamedTuple):
    """A case: the gain of the true kernel, the extent of its blur, and the trials in turn."""

    true: float
    extent: float
    trials: tuple[Trial, ...]

    @property
    def judged(self) -> int:
        """The trial that the judge finds best."""
        return int(np.argmax([trial.margin for trial in self.trials]))


def score(case: Case, folder: Path, factors: Sequence[float], seed: int) -> Scores:
    """Shake a photo and estimate its kernel with each focal length."""
    focal = WIDTHS[case.window % len(WIDTHS)]
    codes, sharp, true = shake(case, folder, seed, focal)
    light, clipped = decode(codes, Srgb()), is_clipped(codes).any(-1)
    grey = luminance(light)
    blurred = psnr(display(light), display(sharp))

    def gain(kernel: RotationKernel) -> float:
        done = restore(light, kernel, RESTORATIONS["sparse"], clipped=clipped, threads=1)
        return aligned_psnr(without_dark_halos(done.pixels, light, kernel), sharp) - blurred

    trials = []
    for factor in factors:
        camera = true.camera
        camera = Camera.from_focal(factor * camera.focal_px, camera.height, camera.width)
        try:
            kernel = estimate_kernel(grey, camera, clipped=clipped, threads=1).kernel
        except EstimationError:
            kernel = RotationKernel.delta(camera)
        moved = kernel.theta[kernel.weights > 0].any()
        trials.append(Trial(gain(kernel) if moved else 0.0, margin(grey, kernel, ~clipped)))
    return Scores(gain(true), true.extent_px(), tuple(trials))


def margin(grey: NDArray[np.float32], kernel: RotationKernel, usable: NDArray[np.bool_]) -> float:
    """How much better the judge finds a kernel than no shake at all; 0 for no shake."""
    small, camera, known = reduced(grey, kernel.camera, usable, JUDGE_SIDE)
    still, found = (
        judge.score(small, trial.for_camera(camera), usable=known, threads=1)
        for trial in (RotationKernel.delta(kernel.camera), kernel)
    )
    return judge.margin(found, still)


def header(factors: Sequence[float]) -> str:
    """Head of the table."""
    cells = ["photo", "focal", "px", "true", *(f"x{factor:g}" for factor in factors), "judged"]
    return "| " + " | ".join(cells) + " |\n" + "|---" * len(cells) + "|"


def line(case: Case, scores: Scores, factors: Sequence[float]) -> str:
    """One case of the table; in brackets, the judge's margin."""
    focal = 36 * WIDTHS[case.window % len(WIDTHS)]
    cells = [f"{case.photo} {case.window}", f"{focal:.0f} mm"]
    cells += [f"{scores.extent:.0f}", f"{scores.true:+.2f}"]
    cells += [f"{trial.gain:+.2f} ({trial.margin:.3f})" for trial in scores.trials]
    won = scores.judged
    cells.append(f"{scores.trials[won].gain:+.2f} (x{factors[won]:g})")
    return "| " + " | ".join(cells) + " |"


def summary(table: Sequence[Scores], factors: Sequence[float]) -> str:
    """Mean and worst loss against the true focal length, for each factor and for the judge's."""
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
    found = [float(part) for part in text.split(",")]
    if 1.0 not in found or min(found) <= 0:
        message = f"{text!r} is not a list of factors with 1 among them"
        raise argparse.ArgumentTypeError(message)
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of orientation logs")
    photos = partial(names, known=PHOTOS)
    parser.add_argument("--photos", type=photos, default=SMALL, help="default: four small ones")
    parser.add_argument("--windows", type=int, default=2, help="paths for each; default: 2")
    parser.add_argument("--factors", type=numbers, default=FACTORS, help="default: 0.5 to 2")
    parser.add_argument("--seed", type=int, default=0, help="of paths and noise; default: 0")
    args = parser.parse_args(argv)
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        find_logs(args.data)
        for photo in args.photos:
            read(photo, args.data)
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
