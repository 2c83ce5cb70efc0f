"""Results for the photos of Köhler et al., scored beside those of other programs.

    python scripts/bench.py replayed-results --results DIR --results DIR ...

R. Köhler et al., *Recording and Playback of Camera Shake*, ECCV 2012. Each folder has the results
of a program, `BlurryS_K.*`: scenes S, each shaken by the same shakes K. The true pictures are not
part of the data. But all photos of a scene show the same, and narrow shakes leave sharp results. So
the mean of these, of all programs, stands for the truth; those of the shake itself are left out.

A result is moved to where it fits best, by a homography, and made as bright. A tenth of the sides
is left out. The numbers are PSNR in dB: they compare programs, and are not those of the
publication.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import MissingDataError
from bench.markdown import head, row
from bench.metrics import decibels, projected

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping, Sequence

Codes = NDArray[np.uint8]
Mean = NDArray[np.float32]
Shake = tuple[int, int]  # scene and number

NARROW = (1, 2, 3, 4, 5, 6, 7, 12)  # shakes of at most 30 px
BORDER = 0.1  # of the sides


def results_in(folder: Path) -> dict[Shake, Path]:
    """Return the results in a folder."""
    found = {}
    for path in sorted(folder.glob("Blurry[0-9]*_[0-9]*.*")):
        scene, _, shake = path.name.split(".")[0].removeprefix("Blurry").partition("_")
        if scene.isdigit() and shake.isdigit() and path.suffix != ".npz":
            found[int(scene), int(shake)] = path
    if not found:
        raise MissingDataError(f"{folder} has no BlurryS_K.*; --results names a folder of results")
    return found


def read(path: Path) -> Codes:
    """Read a result."""
    codes = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if codes is None:
        raise MissingDataError(f"{path} is no picture; --results names a folder of results")
    return np.asarray(codes, np.uint8)


def narrow_means(results: Mapping[int, Sequence[Codes]]) -> dict[int, Mean]:
    """Return the mean result of each narrow shake of a scene; all are moved to fit the first."""
    shakes = [shake for shake in results if shake in NARROW]
    if len(shakes) < 2:
        raise MissingDataError("no other narrow shake of the scene has a result")
    like = results[shakes[0]][0]
    return {shake: np.mean([projected(one, like) for one in results[shake]], 0) for shake in shakes}


def sharp_scene(means: Mapping[int, Mean], without: int) -> Codes:
    """Return the mean of narrow shakes but one."""
    others = [mean for shake, mean in means.items() if shake != without]
    return np.rint(np.mean(others, 0)).astype(np.uint8)


def score(result: Codes, sharp: Codes) -> float:
    """Return the PSNR in dB of a result that is moved and made as bright."""
    inner = tuple(slice(int(BORDER * n), n - int(BORDER * n)) for n in sharp.shape[:2])
    moved = projected(result, sharp)[inner].astype(np.float64)
    truth = sharp[inner].astype(np.float64)
    moved *= (moved * truth).sum() / (moved**2).sum()
    return decibels(float(((moved - truth) ** 2).mean()), 255)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--results",
        type=Path,
        action="append",
        required=True,
        metavar="DIR",
        help="results of a program, BlurryS_K.*; once for each program",
    )


def run(args: argparse.Namespace) -> int:
    """Score the results of the photos that all programs have."""
    folders = [results_in(folder) for folder in args.results]
    common = sorted(set.intersection(*map(set, folders)))
    if not common:
        raise MissingDataError("no photo has a result in all folders that --results names")
    columns = [folder.name for folder in args.results]
    print(head(["photo", *columns]))
    scores = []
    for scene in sorted({scene for scene, _ in common}):
        shakes = [shake for one, shake in common if one == scene]
        results = {shake: [read(one[scene, shake]) for one in folders] for shake in shakes}
        means = narrow_means(results)
        for shake in shakes:
            sharp = sharp_scene(means, shake)
            scores.append([score(result, sharp) for result in results[shake]])
            print(row([f"{scene}_{shake}", *(f"{one:.1f}" for one in scores[-1])]), flush=True)
    print(row(["mean", *(f"{one:.2f}" for one in np.mean(scores, 0))]))
    return 0
