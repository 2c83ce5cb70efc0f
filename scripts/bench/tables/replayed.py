"""Blind estimates for the photos of Köhler et al.: a robot replayed recorded shakes of hands.

    python scripts/bench.py replayed --data DIR

R. Köhler et al., *Recording and Playback of Camera Shake*, ECCV 2012. The folder has
`BlurryS_K.png`: scenes S, each shaken by the same shakes K. The true kernels are not part of the
data. But the first shake is narrow, and so its deblurred photo is a sharp photo of the scene. With
it, `estimate-pair` finds the kernels of the other photos. The kernels of a shake in two scenes show
how far to trust them: `scenes` is their likeness. The values of the files stand for light, which
the files do not say. The pairs are read so, and the photos of the blind estimates are not.

`alike` is the largest correlation of the local filters of the blind kernel and that of the pair
over shifts, on average. A camera that stands still has an `alike`, too. Nobody knows the focal
length.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from bench.arguments import add_jobs
from bench.errors import MissingDataError
from bench.kernel_likeness import similarity
from bench.markdown import head, row
from bench.processes import completed, measured
from deshake.formats.photo import Photo, read_photo
from deshake.run import Run
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.deblurring import deblur
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.pair_estimate import estimate_pair

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from deshake.geometry.kernel import RotationKernel

COLUMNS = ("photo", "shake", "scenes", "result", "alike", "confidence", "CPU s")
FOCAL = 100.0  # mm on 35 mm film: what the pairs assume; most blind estimates are near it
WIDER = "wider than what was looked for"
WIDEST = 0.16  # of the frame's longer side: bound of the second estimate of such a pair


class Result(NamedTuple):
    """A blind estimate and the kernel of the pair."""

    blind: RotationKernel
    pair: RotationKernel
    confidence: float
    seconds: float


def sharp_scene(path: Path) -> Photo:
    """Deblur the photo of the first shake."""
    cv2.setNumThreads(1)
    photo = read_photo(path, transfer="linear")
    kernel = estimate_blind(photo, EstimateOptions(), run=Run(1)).content.kernel
    return deblur(photo, kernel, run=Run(1)).photo


def kernel_of_pair(photo: Photo, sharp: Photo) -> RotationKernel:
    """Estimate the kernel of a photo with a sharp one; look for a wider shake where needed."""
    options = EstimateOptions(camera=CameraChoice(focal_35mm=FOCAL))
    estimate = estimate_pair(photo, sharp, options, run=Run(1))
    if any(WIDER in note for note in estimate.notes):
        bound = WIDEST * max(photo.shape)
        estimate = estimate_pair(photo, sharp, replace(options, blur_size=bound), run=Run(1))
    return estimate.content.kernel


def compared(path: Path, sharp: Photo) -> Result:
    """Estimate the kernel of a photo blindly, and with the sharp photo."""
    cv2.setNumThreads(1)
    photo, linear = read_photo(path), read_photo(path, transfer="linear")
    blind, cost = measured(partial(estimate_blind, photo, EstimateOptions(), run=Run(1)))
    content = blind.content
    return Result(content.kernel, kernel_of_pair(linear, sharp), content.confidence, cost.cpu)


def line(name: str, result: Result, others: Sequence[Result]) -> str:
    """Return the line of a photo; `others` are the results of the same shake in other scenes."""
    truth = result.pair
    extent = truth.extent_px()
    scenes = [similarity(other.pair, truth, extent) for other in others]
    left = result.blind.is_still
    return row(
        [
            name,
            f"{extent:.0f} px",
            f"{np.mean(scenes):.2f}" if scenes else "",
            "left" if left else f"{result.blind.extent_px():.0f} px",
            f"{similarity(result.blind, truth, extent):.2f}",
            "" if left else f"{result.confidence:.2f}",
            f"{result.seconds:.0f}",
        ]
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--data", type=Path, required=True, metavar="DIR", help="folder of BlurryS_K.png"
    )
    add_jobs(parser, 1)


def run(args: argparse.Namespace) -> int:
    """Compare blind kernels with those of pairs, photo by photo."""
    photos = {
        tuple(map(int, path.stem.removeprefix("Blurry").split("_"))): path
        for path in args.data.glob("Blurry[0-9]*_[0-9]*.png")
    }
    scenes = sorted({scene for scene, shake in photos if shake == 1})
    if not scenes:
        raise MissingDataError(f"{args.data} has no Blurry*_1.png; --data names their folder")
    sharp = dict(completed(sharp_scene, {s: (photos[s, 1],) for s in scenes}, args.jobs))
    tasks = {key: (path, sharp[key[0]]) for key, path in photos.items() if key[0] in sharp}
    results = dict(completed(compared, tasks, args.jobs))
    print(head(COLUMNS))
    for (scene, shake), result in sorted(results.items()):
        others = [one for (s, k), one in results.items() if k == shake and s != scene]
        print(line(f"{scene}_{shake}", result, others))
    return 0
