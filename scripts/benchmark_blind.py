"""Compare the blind estimators on photos shaken by recorded hands, with the truth in hand.

    python scripts/benchmark_blind.py --data DIR
    python scripts/benchmark_blind.py --data DIR --photos coffee,china --windows 2 --methods edges

DIR holds orientation logs of a hand-held phone (`hand_shakes`). Two of the photos are looked for
in it, manmade_01.png and houses_big.jpg; development dependencies ship the others. Each is brought
to 900 px on the longer side (four are smaller, and as soft afterwards as photos of cameras are),
blurred in linear light along windows of 1/8 to 1 s of the logs by exact warps, cropped to what was
wholly seen, given the noise of photons and readout and made an 8-bit JPEG. Paths are stretched to
blur by 10 to 40 px.

Each photo is deblurred with the kernel of each method and with the true one. Printed are gains in
PSNR (dB) of display values over the photo as it is, after a shift and turn that fit the truth best:
no blind method can tell where the camera pointed on average. A judge that does not know the truth
chooses between candidates, and refines its choice: `best` is the gain of the best one, `choice` the
one it took, with its confidence. `uniform` is `edges` for one blur all over the frame.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, get_args

import cv2
import numpy as np
from arguments import names
from hand_shakes import find_logs, hand_path
from numpy.typing import NDArray
from PIL import Image as Pictures
from skimage import data
from sklearn.datasets import load_sample_image

from deshake.deconvolution.dark_halos import without_dark_halos
from deshake.deconvolution.methods import RestorationOptions, restore
from deshake.errors import DeshakeError
from deshake.estimation.candidates import STILL
from deshake.estimation.methods import (
    Estimator,
    best_estimate,
    estimate_candidates,
    refined_estimate,
)
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.io.transfer import Srgb, decode, encode, is_clipped
from deshake.operators.shake_blur import ShakeBlur
from deshake.pipelines.stages import luminance

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Image = NDArray[np.float32]
Codes = NDArray[np.uint8]

FOUND = {"manmade": "manmade_01.png", "houses": "houses_big.jpg"}  # in the folder of data
SHIPPED: dict[str, Callable[[], Codes]] = {
    "motorcycle": lambda: data.stereo_motorcycle()[0],
    "china": partial(load_sample_image, "china.jpg"),
    "coffee": data.coffee,
    "astronaut": data.astronaut,
}
PHOTOS = (*FOUND, *SHIPPED)
METHODS = (*get_args(Estimator), "uniform")
RESTORATIONS = {
    "sparse": RestorationOptions(),
    "rl": RestorationOptions(method="rl", iterations=15),
}
LONGEST = 900  # px
FOCAL = 1.1  # widths of the photo
EXTENTS = (10.0, 40.0)  # px
EXPOSURES = (0.125, 1.0)  # s
PHOTONS = 4000  # at full scale
READ_NOISE = 0.003
QUALITY = 92
BORDER = 12  # px left out of the comparison on every side
GREY = np.float32([0.299, 0.587, 0.114])


class Case(NamedTuple):
    """A photo and the number of the path that shakes it."""

    photo: str
    window: int


class Shaken(NamedTuple):
    """A shaken photo (8 bits), the sharp one in linear light, and the true kernel."""

    codes: Codes
    sharp: Image
    kernel: RotationKernel


class Result(NamedTuple):
    """How a method did: gain and best candidate's (dB), choice, confidence, seconds."""

    gain: float
    best: float
    choice: str
    confidence: float
    seconds: float


class Scores(NamedTuple):
    """A case's blurred PSNR, the true kernel's gain, the blur's extent and all methods."""

    blurred: float
    true: float
    extent: float
    methods: dict[str, Result]


class Run(NamedTuple):
    """What all cases have in common."""

    folder: Path
    methods: Sequence[str]
    restoration: str
    seed: int


def read(photo: str, folder: Path) -> Codes:
    """Read a photo, as large as all; raise DeshakeError where it is not in the folder."""
    if photo in SHIPPED:
        picture = Pictures.fromarray(SHIPPED[photo]())
    else:
        places = sorted(folder.rglob(FOUND[photo]))
        if not places:
            raise DeshakeError(f"no {FOUND[photo]}", file=folder, hint="leave it out by --photos")
        picture = Pictures.open(places[0]).convert("RGB")
    scale = LONGEST / max(picture.size)
    size = round(picture.width * scale), round(picture.height * scale)
    way = Pictures.Resampling.BOX if scale < 1 else Pictures.Resampling.BICUBIC
    return np.asarray(picture.resize(size, way))


def shake(case: Case, folder: Path, seed: int, focal: float = FOCAL) -> Shaken:
    """Shake a photo, taken at a focal length in widths."""
    rng = np.random.default_rng([seed, PHOTOS.index(case.photo), case.window])
    sharp = decode(read(case.photo, folder), Srgb())
    high, wide = sharp.shape[:2]
    whole = Camera.from_focal(focal * wide, high, wide)
    path = hand_path(find_logs(folder), rng, EXPOSURES)
    extent = RotationKernel.from_path(path, whole).extent_px()
    path = (path - path.mean(0)) * rng.uniform(*EXTENTS) / extent
    kernel = RotationKernel.from_path(path, whole).centred()
    margin = int(np.ceil(np.abs(kernel.displacements(whole.corners)).max())) + 2
    camera = whole.cropped(margin, margin, wide - 2 * margin, high - 2 * margin)
    kernel = kernel.for_camera(camera)
    light = ShakeBlur(kernel, margin=margin, kind="warps").forward(sharp)
    noise = rng.standard_normal(light.shape) * np.sqrt(light / PHOTONS + READ_NOISE**2)
    file = io.BytesIO()
    codes = encode(np.clip(light + noise, 0, 1), Srgb(), 8)
    Pictures.fromarray(codes).save(file, "JPEG", quality=QUALITY, subsampling=0)
    return Shaken(np.array(Pictures.open(file)), sharp[margin:-margin, margin:-margin], kernel)


def psnr(image: Image, sharp: Image) -> float:
    """PSNR of display values, without the border."""
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    return float(-10 * np.log10(np.square(image - sharp)[inner].mean()))


def display(light: Image) -> Image:
    """Display values, 0..1, of linear light."""
    return Srgb().from_linear(np.clip(light, 0, 1)).astype(np.float32)


def aligned(image: Image, truth: Image) -> Image:
    """Move an image to where it fits the truth best, by a shift and a turn; display values."""
    turn = np.eye(2, 3, dtype=np.float32)
    stop = (3, 60, 1e-5)
    try:
        _, turn = cv2.findTransformECC(
            truth @ GREY, image @ GREY, turn, cv2.MOTION_EUCLIDEAN, stop, None, 3
        )
    except cv2.error:  # nothing fits
        return image
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    size = (image.shape[1], image.shape[0])
    moved: Image = cv2.warpAffine(image, turn, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return moved


def aligned_psnr(light: Image, sharp: Image) -> float:
    """PSNR after the shift and turn that fit best."""
    image, truth = display(light), display(sharp)
    return max(psnr(image, truth), psnr(aligned(image, truth), truth))


def score(case: Case, run: Run) -> Scores:
    """Shake a photo, estimate its kernel by each method, and compare what they restore."""
    codes, sharp, true = shake(case, run.folder, run.seed)
    light, clipped = decode(codes, Srgb()), is_clipped(codes).any(-1)
    grey = luminance(light)
    blurred = psnr(display(light), display(sharp))

    def gain(kernel: RotationKernel) -> float:
        options = RESTORATIONS[run.restoration]
        done = restore(light, kernel, options, clipped=clipped, threads=1)
        return aligned_psnr(without_dark_halos(done.pixels, light, kernel), sharp) - blurred

    results = {}
    for method in run.methods:
        begin = time.process_time()
        candidates = estimate_candidates(
            grey,
            true.camera,
            estimator="edges" if method == "uniform" else method,
            uniform=method == "uniform",
            clipped=clipped,
            threads=1,
        )
        found = best_estimate(grey, candidates, clipped=clipped, threads=1)
        fine = found
        if method != "variational":
            fine = refined_estimate(grey, found, clipped=clipped, threads=1)
        seconds = time.process_time() - begin
        gains = {name: gain(candidate.kernel) for name, candidate in candidates.items()}
        gains[STILL] = 0.0  # the photo is left as it is
        choice = found.name
        if fine is not found:
            choice += ", refined"
            gains[choice] = gain(fine.kernel)
        won, best = gains[choice], max(gains.values())
        results[method] = Result(won, best, choice, found.confidence, seconds)
    return Scores(blurred, gain(true), true.extent_px(), results)


def line(case: Case, scores: Scores) -> str:
    """One case of the table."""
    cells = [f"{case.photo} {case.window}", f"{scores.extent:.0f}", f"{scores.blurred:.1f}"]
    cells.append(f"{scores.true:+.2f}")
    for found in scores.methods.values():
        cells += [f"{found.gain:+.2f}", f"{found.best:+.2f}"]
        cells += [f"{found.choice} {found.confidence:.2f}", f"{found.seconds:.0f}"]
    return "| " + " | ".join(cells) + " |"


def header(methods: Sequence[str]) -> str:
    """Head of the table."""
    cells = ["photo", "px", "blurred", "true"]
    for name in methods:
        cells += [name, "best", "choice", "s"]
    return "| " + " | ".join(cells) + " |\n" + "|---" * len(cells) + "|"


def summary(table: Sequence[Scores], methods: Sequence[str]) -> str:
    """Means, medians and worst cases of each method, and what its confidence is worth."""
    true = np.array([scores.true for scores in table])
    lines = [f"true kernel: mean {true.mean():+.2f} dB, median {np.median(true):+.2f}"]
    for name in methods:
        gain = np.array([scores.methods[name].gain for scores in table])
        best = np.array([scores.methods[name].best for scores in table])
        sure = np.array([scores.methods[name].confidence for scores in table])
        lines.append(
            f"{name}: gain mean {gain.mean():+.2f}, median {np.median(gain):+.2f}, worst "
            f"{gain.min():+.2f}; below the true kernel by {np.median(true - gain):.2f} (median); "
            f"regret mean {(best - gain).mean():.2f}, worst {(best - gain).max():.2f}; confidence "
            f"mean {sure.mean():.2f} where {(gain > 0).mean():.2f} are better than the photo and "
            f"{(gain > true / 2).mean():.2f} gain half of what the true kernel does"
        )
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of orientation logs")
    photos, methods = partial(names, known=PHOTOS), partial(names, known=METHODS)
    parser.add_argument("--photos", type=photos, default=PHOTOS, help="default: all six")
    parser.add_argument("--windows", type=int, default=6, help="paths for each; default: 6")
    default = ["auto", "uniform"]
    parser.add_argument("--methods", type=methods, default=default, help="default: auto,uniform")
    parser.add_argument("--restoration", choices=RESTORATIONS, default="sparse")
    parser.add_argument("--jobs", type=int, default=2, help="cases at once; default: 2")
    parser.add_argument("--seed", type=int, default=0, help="of paths and noise; default: 0")
    args = parser.parse_args(argv)
    try:
        find_logs(args.data)
        for photo in args.photos:
            read(photo, args.data)
    except DeshakeError as error:
        print(f"error: {error}\nhint: {error.hint}", file=sys.stderr)
        return 1
    cases = [Case(photo, window) for window in range(args.windows) for photo in args.photos]
    run = Run(args.data, args.methods, args.restoration, args.seed)
    table: dict[Case, Scores] = {}
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # for what is spawned
    print(header(args.methods), flush=True)
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        works = {pool.submit(score, case, run): case for case in cases}
        for work in as_completed(works):
            case = works[work]
            table[case] = work.result()
            print(line(case, table[case]), flush=True)
    print("\n" + summary([table[case] for case in cases], args.methods))
    return 0


if __name__ == "__main__":
    sys.exit(main())
