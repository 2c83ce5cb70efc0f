"""Reproduce the setting of Fig. 6 of the paper: real uniform blurs with known truth.

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

import sys
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, get_args

import cv2
import numpy as np
from bench.arguments import add_jobs, names
from bench.errors import MissingDataError
from bench.markdown import head, row
from bench.metrics import decibels
from bench.processes import completed, measured
from bench.program import explained, guarded
from numpy.typing import NDArray
from scipy.io import loadmat

from deshake.blind.estimate import Estimator, estimate_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

Image = NDArray[np.float32]

FILES = "im??_flit??.mat"
BORDER = 32  # px left out of the comparison on every side
QUARTERS = 4  # a pixel
LONG_LENS = 20  # focal length where roll is free, in longer sides of the photo
RATIOS = (2, 3)  # that cases are counted by
PUBLISHED = "Fergus 29.46, Cho & Lee 30.79, Levin 2011 31.14, Xu & Jia 31.36, dark channel 31.73"


class LevinPhoto(NamedTuple):
    """A photo, what it should look like, and the kernel (rows, columns) it is correlated with."""

    blurred: Image
    sharp: Image
    filter: NDArray[np.float64]


class Way(NamedTuple):
    """How a kernel is estimated: the estimator, and whether the camera may also roll."""

    estimator: Estimator
    free: bool = False

    def __str__(self) -> str:
        """Name it."""
        return self.estimator + ", roll free" * self.free


class Error(NamedTuple):
    """Mean squared error after the best shift, by quarters of a pixel and by whole ones."""

    quarters: float
    whole: float

    def __str__(self) -> str:
        """Show it as PSNR in dB, that of whole pixels in brackets."""
        return f"{decibels(self.quarters):.2f} ({decibels(self.whole):.2f})"


class Errors(NamedTuple):
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


def matching_files(folder: Path, patterns: str) -> list[Path]:
    """Find the files whose names, less the suffix, match one of the patterns, ``im05*,im06_*``."""
    wanted = [pattern.strip() for pattern in patterns.split(",")]
    return [
        path for path in sorted(folder.glob(FILES)) if any(fnmatch(path.stem, p) for p in wanted)
    ]


def read_case(path: Path) -> LevinPhoto:
    """Read a case."""
    fields = loadmat(path)
    blurred, sharp = (np.ascontiguousarray(fields[name], np.float32) for name in "yx")
    return LevinPhoto(blurred, sharp, np.asarray(fields["f"], np.float64))


def true_kernel(correlated: NDArray[np.float64], camera: Camera) -> RotationKernel:
    """Return the kernel of a camera of the uniform model that correlates with a filter.

    Each pixel of the photo shows what lies by (dx, dy) beside it: turned about Y by dx / f and
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


def score(path: Path, way: Way) -> Errors:
    """Estimate the kernel of a case, and compare what it and the true one restore."""
    cv2.setNumThreads(1)
    case = read_case(path)
    height, width = case.blurred.shape
    long = Camera.from_focal(LONG_LENS * max(height, width), height, width)
    work = partial(estimate_kernel, case.blurred, long, estimator=way.estimator, run=Run(1))
    blind_estimate, cost = measured(partial(work, uniform=not way.free))

    def error(kernel: RotationKernel) -> Error:
        restored = sparse_gradients(case.blurred, kernel, run=Run(1)).pixels
        return shifted_error(np.clip(restored, 0, 1), case.sharp)

    true = true_kernel(case.filter, Camera.uniform(height, width))
    return Errors(
        error(blind_estimate.kernel),
        error(true),
        shifted_error(case.blurred, case.sharp),
        blind_estimate.name,
        cost.seconds,
    )


def mean_cells(scores: Sequence[Errors]) -> list[str]:
    """Sum up the scores of an estimator: means of the PSNR, ratios, seconds."""
    columns = []
    for errors in zip(*((s.estimated, s.true, s.blurred) for s in scores), strict=True):
        quarters, whole = (
            np.mean([decibels(getattr(e, way)) for e in errors]) for way in Error._fields
        )
        columns.append(f"{quarters:.2f} ({whole:.2f})")
    ratios = np.array([s.ratio for s in scores])
    counts = ", ".join(f"{int((ratios <= most).sum())} <= {most}" for most in RATIOS)
    seconds = np.mean([s.seconds for s in scores])
    return [*columns, f"{counts} of {len(ratios)}", "", f"{seconds:.1f}"]


def table(scores: dict[str, Errors], title: str) -> str:
    """Write the scores of one estimator by case, and their means, in Markdown."""
    titles = ["estimated", "true kernel", "blurred", "error ratio", "kernel", "seconds"]
    lines = [
        row([case, s.estimated, s.true, s.blurred, f"{s.ratio:.2f}", s.name, f"{s.seconds:.1f}"])
        for case, s in sorted(scores.items())
    ]
    return "\n".join(
        [head([title, *titles]), *lines, row(["mean", *mean_cells(list(scores.values()))])]
    )


def score_all(paths: Sequence[Path], args: argparse.Namespace) -> dict[Way, dict[str, Errors]]:
    """Score all cases, some at once, and print each as it is done."""
    models = (False, True) if args.free else (False,)
    scores: dict[Way, dict[str, Errors]] = {
        Way(estimator, free): {} for estimator in args.estimators for free in models
    }
    tasks = {(path.stem, way): (path, way) for way in scores for path in paths}
    for (case, way), scored in completed(score, tasks, args.jobs):
        scores[way][case] = scored
        print(
            f"{case} {way}: {scored.estimated}, ratio {scored.ratio:.2f}, {scored.seconds:.0f} s",
            file=sys.stderr,
            flush=True,
        )
    return scores


def run(args: argparse.Namespace) -> int:
    """Run the protocol, and print the tables."""
    paths = matching_files(args.data, args.cases)
    if not paths:
        raise MissingDataError(
            f"{args.data}: no case {args.cases}; --data names the folder of {FILES}"
        )
    for way, scores in score_all(paths, args).items():
        print(table(scores, str(way)), end="\n\n")
    print(f"Published means, of 32 photos: {PUBLISHED}.")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Read the command line, and run the protocol."""
    parser = explained(__doc__)
    parser.add_argument("--data", type=Path, required=True, help=f"folder that holds {FILES}")
    parser.add_argument("--cases", default="*", help="such as im06_flit02 or im05*; default: all")
    parser.add_argument(
        "--estimators",
        type=partial(names, known=get_args(Estimator)),
        default=["edges"],
        help="of edges,variational; default: edges",
    )
    parser.add_argument("--free", action="store_true", help="score the rotational model, too")
    add_jobs(parser, 2)
    return guarded(partial(run, parser.parse_args(argv)))


if __name__ == "__main__":
    sys.exit(main())
