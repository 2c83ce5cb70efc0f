"""Compare the blind estimators on photos shaken by recorded hands, with the truth in hand.

    python scripts/benchmark_blind.py --data DIR
    python scripts/benchmark_blind.py --data DIR --photos coffee,china --windows 2 --jobs 1

DIR, or its folder nexus5, holds orientation logs of a hand-held phone (Hee Park & Levoy, CVPR
2014): two lines of header, then time, sensor time in nanoseconds and a rotation matrix. Windows of
1/8 to 0.8 s are cut out of them at random. Photos, which a development dependency ships, are
blurred in linear light along such a path by exact warps, cropped to what was wholly seen, given
the noise of photons and readout and made 8-bit JPEGs. The path is stretched to blur by 8 to 28 px.

Each kernel is handed to plain Richardson-Lucy, Eq. (11), and so is the true one. Printed are gains
in PSNR (dB) of display values over the photo as it is, after a shift and turn that fit the truth
best: no blind method can tell where the camera pointed on average. `edges` tries several settings
and is judged without the truth; `choice` is what was chosen, with its confidence, `best` the gain
of the best candidate. `uniform` is the same without roll and perspective.
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
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures
from skimage import data
from sklearn.datasets import load_sample_image

from deshake.deconvolution.richardson_lucy import richardson_lucy
from deshake.errors import DeshakeError
from deshake.estimation.blind import estimate_blind
from deshake.estimation.candidates import choose, edge_candidates
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import angle_axis
from deshake.io.transfer import Srgb, decode, encode, is_clipped
from deshake.operators.shake_blur import ShakeBlur

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Image = NDArray[np.float32]

PHOTOS: dict[str, Callable[[], NDArray[np.uint8]]] = {
    "astronaut": data.astronaut,
    "coffee": data.coffee,
    "china": partial(load_sample_image, "china.jpg"),
    "chelsea": data.chelsea,
    "flower": partial(load_sample_image, "flower.jpg"),
    "motorcycle": lambda: data.stereo_motorcycle()[0],
}
METHODS = ("edges", "variational", "uniform")
FOCAL = 1.1  # widths of the photo
EXPOSURES = (0.125, 0.8)  # s
EXTENTS = (8.0, 28.0)  # px
PHOTONS = 4000  # at full scale
READ_NOISE = 0.003
QUALITY = 92
ITERATIONS = 15  # of Eq. (11)
BORDER = 12  # px left out of the comparison on every side
GREY = np.float32([0.299, 0.587, 0.114])


class Case(NamedTuple):
    """A photo and the number of the path that shakes it."""

    photo: str
    window: int


class Shaken(NamedTuple):
    """A shaken photo (8 bits), the sharp one in linear light, and the true kernel."""

    codes: NDArray[np.uint8]
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


def read_log(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read times (T,) in seconds and rotation matrices (T, 3, 3)."""
    times, matrices = [], []
    for line in path.read_text("utf-8").splitlines()[2:]:
        fields = line.replace("[", "").replace("]", "").split(",")
        if len(fields) >= 11:
            times.append(int(fields[1]) * 1e-9)
            matrices.append([float(field) for field in fields[2:11]])
    return np.array(times), np.array(matrices).reshape(-1, 3, 3)


def hand_path(logs: Sequence[Path], rng: np.random.Generator) -> NDArray[np.float64]:
    """Cut a window out of a log: orientations (T, 3) of the camera against its middle one."""
    times, matrices = read_log(logs[rng.integers(len(logs))])
    exposure = rng.uniform(*EXPOSURES)
    start = times[0] + rng.uniform() * (times[-1] - times[0] - exposure)
    seen = matrices[(times >= start) & (times < start + exposure)]
    turned = np.einsum("nij,ik->njk", seen, seen[len(seen) // 2])
    return angle_axis(turned) * [1, -1, -1]  # from the phone's axes to the camera's


def shake(case: Case, logs: Sequence[Path], seed: int) -> Shaken:
    """Shake a photo."""
    rng = np.random.default_rng([seed, list(PHOTOS).index(case.photo), case.window])
    sharp = decode(PHOTOS[case.photo]()[..., :3], Srgb())
    high, wide = sharp.shape[:2]
    whole = Camera.from_focal(FOCAL * wide, high, wide)
    path = hand_path(logs, rng)
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
    photo = np.array(Pictures.open(file))
    return Shaken(photo, sharp[margin:-margin, margin:-margin], kernel)


def psnr(image: Image, sharp: Image) -> float:
    """PSNR of display values, without the border."""
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    return float(-10 * np.log10(np.square(image - sharp)[inner].mean()))


def display(light: Image) -> Image:
    """Display values, 0..1, of linear light."""
    return Srgb().from_linear(np.clip(light, 0, 1)).astype(np.float32)


def aligned_psnr(light: Image, sharp: Image) -> float:
    """PSNR after the shift and turn that fit best."""
    image, truth = display(light), display(sharp)
    turn = np.eye(2, 3, dtype=np.float32)
    stop = (3, 60, 1e-5)
    try:
        _, turn = cv2.findTransformECC(
            truth @ GREY, image @ GREY, turn, cv2.MOTION_EUCLIDEAN, stop, None, 3
        )
    except cv2.error:  # nothing fits
        return psnr(image, truth)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    size = (image.shape[1], image.shape[0])
    moved = cv2.warpAffine(image, turn, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return max(psnr(image, truth), psnr(moved, truth))


def score(case: Case, logs: Sequence[Path], methods: Sequence[str], seed: int) -> Scores:
    """Shake a photo, estimate its kernel by each method, and compare what they restore."""
    codes, sharp, true = shake(case, logs, seed)
    light = decode(codes, Srgb())
    usable = cv2.dilate(is_clipped(codes).any(-1).astype(np.uint8), np.ones((3, 3))) == 0
    grey = light @ GREY
    blurred = psnr(display(light), display(sharp))

    def gain(kernel: RotationKernel) -> float:
        done = richardson_lucy(light, kernel, iterations=ITERATIONS, accelerated=False, threads=1)
        return aligned_psnr(done.pixels, sharp) - blurred

    results = {}
    for method in methods:
        begin = time.process_time()
        if method == "variational":
            found = estimate_blind(grey, true.camera, clipped=~usable, threads=1)
            seconds = time.process_time() - begin
            won = gain(found.kernel)
            results[method] = Result(won, won, method, found.confidence, seconds)
            continue
        camera = Camera.uniform(*grey.shape) if method == "uniform" else true.camera
        candidates = edge_candidates(grey, camera, usable=usable, threads=1)
        kernels = {name: candidate.kernel for name, candidate in candidates.items()}
        choice = choose(grey, kernels, usable=usable, threads=1)
        seconds = time.process_time() - begin
        gains = {name: gain(kernel) for name, kernel in kernels.items()}
        best = max(gains.values())
        results[method] = Result(gains[choice.name], best, choice.name, choice.confidence, seconds)
    return Scores(blurred, gain(true), true.extent_px(), results)


def line(case: Case, scores: Scores) -> str:
    """One case of the table."""
    cells = [f"{case.photo} {case.window}", f"{scores.extent:.0f}", f"{scores.blurred:.1f}"]
    cells.append(f"{scores.true:+.2f}")
    for name, found in scores.methods.items():
        cells += [f"{found.gain:+.2f}"]
        if name != "variational":
            cells += [f"{found.best:+.2f}", f"{found.choice} {found.confidence:.2f}"]
        cells += [f"{found.seconds:.0f}"]
    return "| " + " | ".join(cells) + " |"


def header(methods: Sequence[str]) -> str:
    """Head of the table."""
    cells = ["photo", "px", "blurred", "true"]
    for name in methods:
        cells += [name, "s"] if name == "variational" else [name, "best", "choice", "s"]
    return "| " + " | ".join(cells) + " |\n" + "|---" * len(cells) + "|"


def summary(table: Sequence[Scores], methods: Sequence[str]) -> str:
    """Means, medians and worst cases of each method."""
    true = np.array([scores.true for scores in table])
    lines = [f"true kernel: mean {true.mean():+.2f} dB, median {np.median(true):+.2f}"]
    for name in methods:
        gain = np.array([scores.methods[name].gain for scores in table])
        best = np.array([scores.methods[name].best for scores in table])
        sure = np.array([scores.methods[name].confidence >= 0.5 for scores in table])
        kept = np.where(sure, gain, 0)
        lines.append(
            f"{name}: gain mean {gain.mean():+.2f}, median {np.median(gain):+.2f}, worst "
            f"{gain.min():+.2f}; below the true kernel by {np.median(true - gain):.2f} (median); "
            f"regret mean {(best - gain).mean():.2f}, worst {(best - gain).max():.2f}; "
            f"left alone below confidence 0.5: mean {kept.mean():+.2f}, worst {kept.min():+.2f}"
        )
    return "\n".join(lines)


def find_logs(folder: Path) -> list[Path]:
    """Find the orientation logs of a folder; raise DeshakeError where there are none."""
    logs = sorted(folder.glob("*.txt")) or sorted((folder / "nexus5").glob("*.txt"))
    if not logs:
        raise DeshakeError(
            "no orientation logs", file=folder, hint="--data names the folder of the *.txt logs"
        )
    return logs


def names(text: str, known: Sequence[str]) -> list[str]:
    """Read a list of names, separated by commas."""
    found = [name.strip() for name in text.split(",")]
    if not set(found) <= set(known):
        message = f"{text!r} is not among {', '.join(known)}"
        raise argparse.ArgumentTypeError(message)
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of orientation logs")
    photos, methods = partial(names, known=list(PHOTOS)), partial(names, known=METHODS)
    parser.add_argument("--photos", type=photos, default=list(PHOTOS), help="default: all six")
    parser.add_argument("--windows", type=int, default=6, help="paths for each; default: 6")
    parser.add_argument("--methods", type=methods, default=["edges"], help="default: edges")
    parser.add_argument("--jobs", type=int, default=2, help="cases at once; default: 2")
    parser.add_argument("--seed", type=int, default=0, help="of paths and noise; default: 0")
    args = parser.parse_args(argv)
    try:
        logs = find_logs(args.data)
    except DeshakeError as error:
        print(f"error: {error}\nhint: {error.hint}", file=sys.stderr)
        return 1
    cases = [Case(photo, window) for window in range(args.windows) for photo in args.photos]
    table: dict[Case, Scores] = {}
    os.environ["OMP_NUM_THREADS"] = "1"  # for the processes to come: one thread each
    print(header(args.methods), flush=True)
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        works = {pool.submit(score, case, logs, args.methods, args.seed): case for case in cases}
        for work in as_completed(works):
            case = works[work]
            table[case] = work.result()
            print(line(case, table[case]), flush=True)
    print("\n" + summary([table[case] for case in cases], args.methods))
    return 0


if __name__ == "__main__":
    sys.exit(main())
