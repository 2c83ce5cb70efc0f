"""Fig. 7 of the paper, for any pair: a blurred and a noisy photo, and their results.

    python scripts/figure7.py BLURRED NOISY -o sheet.png
    python scripts/figure7.py BLURRED NOISY --beside their-result.png -o sheet.png
    python scripts/figure7.py --case "coffee 20 px, 0.06" --data DIR -o sheet.png

The sheet has the blurred photo, the noisy one (registered, and as bright), and what `fix --noisy`
makes of them by the uniform and by the rotational model; below, the parts with most detail at twice
the size; then both kernels as cuboids, and as local filters over the frame.

A case is a simulated pair (`bench.cases.pairs`), whose truth stands at the end; DIR, or its folder
nexus5, holds orientation logs of a hand-held phone (`bench.hands`).
"""

from __future__ import annotations

import sys
import textwrap
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from bench.arguments import add_threads, at_least
from bench.cases.pairs import PAIRS, shaken_pair
from bench.hands import find_logs
from bench.metrics import Score, display
from bench.program import check_sheet_name, explained, guarded
from numpy.typing import NDArray
from PIL import Image

from deshake.files.disk import check_output
from deshake.files.kernel_file import CameraFile
from deshake.formats.photo import Photo, read_photo
from deshake.formats.transfer import decode
from deshake.geometry.rotations import compose
from deshake.pair.registration import registered
from deshake.pictures.render import render_filters, render_kernel
from deshake.pictures.sheets import CHARACTER, GAP, Row, detailed_part, resized, sheet, shown
from deshake.run import Run
from deshake.signal.luminance import luminance
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.deblurring import deblur
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.methods import RestorationOptions
from deshake.stages.pair_estimate import estimate_pair
from deshake.stages.registering import find_registration

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from deshake.geometry.kernel import RotationKernel
    from deshake.pictures.canvas import Picture
    from deshake.stages.estimate_result import Estimate
    from deshake.stages.registering import RegistrationResult

WIDTH = 400
LEAST_WIDTH = 120
FILTERS = (5, 7)  # down and across
YELLOW, HUES, STRONG = 29, 5, 170  # hue of 180, saturation and value of 255
AROUND = 7  # px, with the lines' dark edges
MODELS = ("uniform", "rotational")

Frame = NDArray[np.float64]


class PairToShow(NamedTuple):
    """A pair, the options of its estimate, and the sharp photo of a registration, if known."""

    name: str
    blurred: Photo
    noisy: Photo
    options: EstimateOptions
    truth: Callable[[Frame], Photo] | None = None


class PairResults(NamedTuple):
    """The registration, both kernels, both results, and the seconds of a pair."""

    registering: RegistrationResult
    kernels: dict[str, Estimate]
    results: dict[str, Photo]
    seconds: float


def simulated(name: str, data: Path, *, camera_files: bool) -> PairToShow:
    """Make a simulated pair."""
    pair = shaken_pair(PAIRS[name]._replace(camera_files=camera_files), find_logs(data))
    blurred, noisy = pair.photos()

    def truth(theta: Frame) -> Photo:
        return blurred.with_pixels(pair.sharp(compose(pair.theta, -theta)))

    options = EstimateOptions(camera=CameraChoice(file=CameraFile(pair.kernel.camera, "the truth")))
    return PairToShow(name, blurred, noisy, options, truth)


def deblurred(pair: PairToShow, threads: int) -> PairResults:
    """Run the stages of `fix --noisy` on a pair, with both models."""
    start = time.perf_counter()
    g, f_N = pair.blurred, pair.noisy
    registering = find_registration(g, f_N, pair.options, run=Run(threads))
    registration = registering.registration
    kernels, results = {}, {}
    for model in MODELS:
        options = EstimateOptions(**vars(pair.options) | {"uniform": model == "uniform"})
        known = {"registration": registration, "run": Run(threads)}
        kernels[model] = estimate_pair(g, f_N, options, **known)
        kernel = kernels[model].content.kernel
        results[model] = deblur(g, kernel, RestorationOptions("fusion"), noisy=f_N, **known).photo
    return PairResults(registering, kernels, results, time.perf_counter() - start)


def noisy_in_frame(pair: PairToShow, registering: RegistrationResult) -> Photo:
    """Return the noisy photo, registered to the blurred one and as bright."""
    f_N = pair.noisy.pixels
    if pair.blurred.pixels.ndim == 2:
        f_N = luminance(f_N)
    elif f_N.ndim == 2:
        f_N = np.dstack([f_N] * 3)
    pixels, _ = registered(f_N, registering.registration)
    return pair.blurred.with_pixels(pixels * np.float32(registering.registration.scale))


def caption(pair: PairToShow, done: PairResults, columns: int) -> list[str]:
    """Describe the results, in lines of so many characters."""
    facts = done.registering.report()
    turned = ", ".join(f"{angle:.2f}" for angle in facts["theta_degrees"])
    height, width = pair.blurred.shape
    scale, confidence = facts["scale"], facts["confidence"]
    lines = [
        f"{pair.name}   {width} x {height}   {done.seconds:.0f} s",
        f"noisy: turned by {turned} degrees, {scale:.3g} times darker, confidence {confidence:.2f}",
    ]
    for model, kernel in done.kernels.items():
        report = kernel.report()
        lines.append(
            f"{model}: {report['rotations']} rotations, extent {report['extent_px']:.1f} px, "
            f"confidence {report['confidence']:.2f}"
        )
        lines += [f"{model}: {note}" for note in kernel.notes]
    lines += done.registering.notes
    return [part for text in lines for part in textwrap.wrap(text, columns)]


def score(photo: Photo, truth: Photo) -> str:
    """PSNR and SSIM of display values."""
    likeness = Score.of(display(photo.pixels), display(truth.pixels))
    return f"  {likeness.psnr:.2f} dB, {likeness.ssim:.3f}"


def lay_out(pair: PairToShow, done: PairResults, beside: Sequence[Path], width: int) -> list[Row]:
    """Lay out the lines of the sheet."""
    photos = {
        "blurred": pair.blurred,
        "noisy": noisy_in_frame(pair, done.registering),
    } | done.results
    names = list(photos)
    if pair.truth is not None:
        truth = pair.truth(done.registering.registration.theta)
        names = [name + score(photo, truth) for name, photo in photos.items()]
        photos["truth"] = truth
        names.append("truth")
    pictures = [shown(photo) for photo in photos.values()]
    names += [path.name for path in beside]
    pictures += [others(path, pictures[0].shape) for path in beside]
    small = [resized(picture, width) for picture in pictures]
    # chosen in the noisy photo: neither blur nor ringing may count as detail
    part = detailed_part(pictures[1], width // 2, width * 3 // 8)
    close = [resized(picture[part], width) for picture in pictures]
    kernels: dict[str, RotationKernel] = {
        model: kernel.content.kernel for model, kernel in done.kernels.items()
    }
    # each on its own axes: the uniform model's camera is another
    cuboids = [render_kernel(kernel, size=width) for kernel in kernels.values()]
    filters = [render_filters(kernel, *FILTERS, size=width) for kernel in kernels.values()]
    columns = int((len(small) * (width + GAP)) / CHARACTER)
    lines = caption(pair, done, columns)
    return [
        Row(lines, small, titles=names),
        Row([], close),
        Row([], [*cuboids, *filters], titles=[*MODELS, *MODELS]),
    ]


def others(path: Path, shape: tuple[int, ...]) -> Picture:
    """Read another picture of the pair, brought to its size."""
    picture = shown(read_photo(path))
    if picture.shape != shape:
        picture = np.asarray(Image.fromarray(picture).resize(shape[1::-1]))
    return picture


def without_boxes(photo: Photo) -> Photo:
    """Paint over the thin yellow lines that a picture out of the paper carries."""
    codes = shown(photo)
    hue, saturation, value = np.moveaxis(cv2.cvtColor(codes, cv2.COLOR_RGB2HSV), -1, 0)
    yellow = (abs(hue.astype(int) - YELLOW) < HUES) & (saturation > STRONG) & (value > STRONG)
    thick = cv2.dilate(yellow.astype(np.uint8), np.ones((AROUND, AROUND), np.uint8))
    painted = cv2.inpaint(codes, thick, AROUND, cv2.INPAINT_TELEA)
    return photo.with_pixels(decode(painted, photo.encoding.transfer))


def chosen(parser: argparse.ArgumentParser, args: argparse.Namespace) -> PairToShow:
    """Return the pair that the arguments name."""
    if args.case is not None:
        if args.photos or args.data is None:
            parser.error("--case needs --data, and no photos")
        return simulated(args.case, args.data, camera_files=args.camera_files)
    if len(args.photos) != 2:
        parser.error("name a blurred and a noisy photo, or a --case")
    check_output(args.output, *args.photos, *args.beside, overwrite=True)
    g, f_N = (read_photo(path) for path in args.photos)
    if args.boxes:
        g, f_N = without_boxes(g), without_boxes(f_N)
    options = EstimateOptions(
        camera=CameraChoice(focal_35mm=args.focal_35mm), blur_size=args.blur_size
    )
    return PairToShow(" + ".join(path.name for path in args.photos), g, f_N, options)


def main(argv: Sequence[str] | None = None) -> int:
    """Deblur the pair and draw the sheet."""
    parser = explained(__doc__)
    parser.add_argument("photos", nargs="*", type=Path, metavar="PHOTO", help="blurred, then noisy")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the sheet, PNG or JPEG")
    parser.add_argument("--case", choices=PAIRS, metavar="CASE", help="a simulated pair instead")
    parser.add_argument("--data", type=Path, help="folder of orientation logs, for --case")
    parser.add_argument("--camera-files", action="store_true", help="the case as cameras' JPEGs")
    parser.add_argument("--focal-35mm", type=float, metavar="MM", help="default: from EXIF")
    parser.add_argument("--blur-size", type=float, metavar="PX", help="default: estimated")
    parser.add_argument("--boxes", action="store_true", help="paint over thin yellow lines first")
    parser.add_argument(
        "--beside", type=Path, nargs="+", default=[], metavar="PHOTO", help="other results to show"
    )
    least = partial(at_least, LEAST_WIDTH)
    parser.add_argument(
        "--width", type=least, default=WIDTH, help=f"of a picture on the sheet; default: {WIDTH}"
    )
    add_threads(parser, 1)
    args = parser.parse_args(argv)

    def run() -> int:
        check_sheet_name(args.output)
        pair = chosen(parser, args)
        done = deblurred(pair, args.threads)
        sheet(lay_out(pair, done, args.beside, args.width)).save(args.output)
        return 0

    return guarded(run)


if __name__ == "__main__":
    sys.exit(main())
