"""Reproduce the setting of Fig. 6 of the paper: real uniform blurs with the truth in hand.

    python scripts/figure6.py --data DIR
    python scripts/figure6.py --data DIR --cases im06_flit02 --estimators edges,variational --free

DIR holds photos of Levin et al., "Understanding and evaluating blind deconvolution algorithms",
CVPR 2009, one in a .mat file: y, of 255 x 255 pixels, is the sharp photo x correlated with the
kernel f, by a real camera and not by computation, up to a shift. Fig. 6 shows im06_flit02. Values
are taken as linear light. Each estimator estimates a kernel of the uniform model; with --free the
camera may also turn about the optical axis, with a long lens. The default restoration deblurs with
that kernel and with the true one.

Printed are PSNRs (dB) of the interior. No blind method can know where the camera pointed on
average: as in the authors' own evaluation, the restored photo is shifted by quarters of a pixel,
linearly interpolated, to where it fits the sharp one best. In brackets is the PSNR with shifts by
whole pixels only. The error ratio is the squared error with the estimated kernel over that with the
true one.
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from fnmatch import fnmatch
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, get_args

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from deshake.blind.estimate import Estimator, estimate_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Sequence

Image = NDArray[np.float32]

FILES = "im??_flit??.mat"
BORDER = 32  # px left out of the comparison on every side
QUARTERS = 4  # a pixel
LONG_LENS = 20  # focal length where roll is free, in longer sides of the photo
RATIOS = (2, 3)  # that cases are counted by
PUBLISHED = "Fergus 29.46, Cho & Lee 30.79, Levin 2011 31.14, Xu & Jia 31.36, dark channel 31.73"


class Case(NamedTuple):
    """A photo, what it should look like, and the kernel (rows, columns) it is correlated with."""

    blurred: Image
    sharp: Image
    filter: NDArray[np.float64]


class Error(NamedTuple):
    """Mean squared error after the best shift, by quarters of a pixel and by whole ones."""

    quarters: float
    whole: float

    def __str__(self) -> str:
        """Show it as PSNR in dB, that of whole pixels in brackets."""
        return f"{psnr(self.quarters):.2f} ({psnr(self.whole):.2f})"


class Score(NamedTuple):
    """Errors with the estimated kernel, the true one, and none; which kernel; seconds it took."""

    estimated: Error
    true: Error
    blurred: Error
    name: str
    seconds: float

    @property
    def ratio(self) -> float:
        """Error ratio."""
        return self.estimated.quarters / self.true.quarters


def psnr(squared: float) -> float:
    """Return the PSNR in dB of a mean squared error, the peak being 1."""
    return float(-10 * np.log10(squared))


def parse_estimators(text: str) -> list[Estimator]:
    """Read names of estimators, ``edges,variational``."""
    known: dict[str, Estimator] = {name: name for name in get_args(Estimator)}
    names = [name.strip() for name in text.split(",")]
    if not set(names) <= set(known):
        message = f"{text!r} is not among {','.join(known)}"
        raise argparse.ArgumentTypeError(message)
    return [known[name] for name in names]


def found_cases(folder: Path, patterns: str) -> list[Path]:
    """Find the files whose names, less the suffix, match one of the patterns, ``im05*,im06_*``."""
    wanted = [pattern.strip() for pattern in patterns.split(",")]
    return [
        path for path in sorted(folder.glob(FILES)) if any(fnmatch(path.stem, p) for p in wanted)
    ]


def read_case(path: Path) -> Case:
    """Read a case."""
    fields = loadmat(path)
    blurred, sharp = (np.ascontiguousarray(fields[name], np.float32) for name in "yx")
    return Case(blurred, sharp, np.asarray(fields["f"], np.float64))


def true_kernel(correlated: NDArray[np.float64], camera: Camera) -> RotationKernel:
    """Return the kernel of a camera of the uniform model that correlates with a filter.

    The photo sees at each pixel what lies by (dx, dy) beside it: turned about Y by dx / f and
    about X by -dy / f.
    """
    rows, columns = np.nonzero(correlated)
    dy, dx = rows - correlated.shape[0] // 2, columns - correlated.shape[1] // 2
    theta = np.stack([-dy, dx, np.zeros(len(rows))], 1) / camera.focal_px
    weights = correlated[rows, columns]
    return RotationKernel(theta, weights / weights.sum(), grid_steps(camera), camera)


def shifted_error(restored: Image, sharp: Image) -> Error:
    """Compare the interior after the best shift, which is anywhere within the border."""
    height, width = sharp.shape
    inner = sharp[BORDER : height - BORDER, BORDER : width - BORDER]
    fits = cv2.matchTemplate(restored, inner, cv2.TM_SQDIFF)
    x, y = cv2.minMaxLoc(fits)[2]
    size = inner.shape[::-1]
    errors = {}
    for down in range(-QUARTERS, QUARTERS + 1):
        for right in range(-QUARTERS, QUARTERS + 1):
            move = np.array([[1, 0, x + right / QUARTERS], [0, 1, y + down / QUARTERS]])
            way = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            part = cv2.warpAffine(restored, move, size, flags=way, borderMode=cv2.BORDER_REPLICATE)
            errors[down, right] = float(np.square(part - inner, dtype=np.float64).mean())
    return Error(min(errors.values()), errors[0, 0])


def score(path: Path, estimator: Estimator, *, free: bool) -> Score:
    """Estimate the kernel of a case, and compare what it and the true one restore."""
    cv2.setNumThreads(1)
    case = read_case(path)
    height, width = case.blurred.shape
    long = Camera.from_focal(LONG_LENS * max(height, width), height, width)
    start = time.perf_counter()
    blind_estimate = estimate_kernel(
        case.blurred, long, estimator=estimator, uniform=not free, run=Run(1)
    )
    seconds = time.perf_counter() - start

    def error(kernel: RotationKernel) -> Error:
        restored = sparse_gradients(case.blurred, kernel, run=Run(1)).pixels
        return shifted_error(np.clip(restored, 0, 1), case.sharp)

    true = true_kernel(case.filter, Camera.uniform(height, width))
    return Score(
        error(blind_estimate.kernel),
        error(true),
        shifted_error(case.blurred, case.sharp),
        blind_estimate.name,
        seconds,
    )


def summary(scores: Sequence[Score]) -> str:
    """Sum up the scores of an estimator: means of the PSNR, ratios, seconds."""
    columns = []
    for errors in zip(*((s.estimated, s.true, s.blurred) for s in scores), strict=True):
        quarters, whole = (
            np.mean([psnr(getattr(e, way)) for e in errors]) for way in Error._fields
        )
        columns.append(f"{quarters:.2f} ({whole:.2f})")
    ratios = np.array([s.ratio for s in scores])
    counts = ", ".join(f"{int((ratios <= most).sum())} <= {most}" for most in RATIOS)
    seconds = np.mean([s.seconds for s in scores])
    return " | ".join([*columns, f"{counts} of {len(ratios)}", "", f"{seconds:.1f}"])


def table(scores: dict[str, Score], title: str) -> str:
    """Write the scores of one estimator by case, and their means, in Markdown."""
    lines = [
        f"| {title} | estimated | true kernel | blurred | error ratio | kernel | seconds |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {case} | {s.estimated} | {s.true} | {s.blurred} | {s.ratio:.2f} | {s.name} "
        f"| {s.seconds:.1f} |"
        for case, s in sorted(scores.items())
    ]
    return "\n".join([*lines, f"| mean | {summary(list(scores.values()))} |"])


def run(
    paths: Sequence[Path], args: argparse.Namespace
) -> dict[tuple[Estimator, bool], dict[str, Score]]:
    """Score all cases, some at once, and print each as it is done."""
    models = (False, True) if args.free else (False,)
    scores: dict[tuple[Estimator, bool], dict[str, Score]] = {
        (estimator, free): {} for estimator in args.estimators for free in models
    }
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        works = {
            pool.submit(score, path, estimator, free=free): (path.stem, estimator, free)
            for estimator, free in scores
            for path in paths
        }
        for work in as_completed(works):
            case, estimator, free = works[work]
            scores[estimator, free][case] = scored = work.result()
            print(
                f"{case} {estimator}{' free' * free}: {scored.estimated}, "
                f"ratio {scored.ratio:.2f}, {scored.seconds:.0f} s",
                file=sys.stderr,
                flush=True,
            )
    return scores


def main(argv: Sequence[str] | None = None) -> int:
    """Run the protocol."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help=f"folder that holds {FILES}")
    parser.add_argument("--cases", default="*", help="such as im06_flit02 or im05*; default: all")
    parser.add_argument(
        "--estimators",
        type=parse_estimators,
        default=["edges"],
        help="of edges,variational; default: edges",
    )
    parser.add_argument("--free", action="store_true", help="score the rotational model, too")
    parser.add_argument("--jobs", type=int, default=2, help="cases at once; default: 2")
    args = parser.parse_args(argv)
    paths = found_cases(args.data, args.cases)
    if not paths:
        print(f"error: {args.data}: no case {args.cases}", file=sys.stderr)
        print(f"hint: --data names the folder of {FILES}", file=sys.stderr)
        return 1
    for (estimator, free), scores in run(paths, args).items():
        print(table(scores, estimator + ", roll free" * free), end="\n\n")
    print(f"Published means, of 32 photos: {PUBLISHED}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
