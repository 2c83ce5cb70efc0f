"""Deblur photos with the help of noisy ones, on pairs that are made here with known truth.

    python scripts/bench.py pair --data DIR
    python scripts/bench.py pair --data DIR --cases "coffee*; *0.06" --blind --crops out
    python scripts/bench.py pair --data DIR --camera-files

DIR, or its folder nexus5, holds orientation logs of a hand-held phone (`bench.hands`);
`bench.cases.pairs` describes how the pairs are made. Each passes the stages of `fix --noisy`.

`off` is the error of the estimated rotation, against the true one relative to the centroid of the
blur: pixels, the root mean square over the frame. All else is PSNR (dB) and SSIM of display values
over the whole frame, border included:

- blurred, noisy, denoised: the photos themselves, the noisy one as bright as the truth or, with
  camera files, with the tones of the blurred one; denoised in the same way as the fusion's guide;
- single: the blurred photo alone, deblurred with the true kernel;
- blind: the blurred photo alone, at the lowest noise, after the shift and turn that fit the truth
  best (with --blind, which takes long; once for each shake);
- uniform: fusion, with a kernel of the uniform model;
- residual, fusion: both methods, with the estimated kernel;
- stopped: residual at the number of iterations with the best PSNR, which needs the truth;
- true: fusion with the true kernel, in the estimated frame.

`overlap` is the part that both photos show. --ways chooses from single, uniform, residual, stopped,
fusion and true.
"""

from __future__ import annotations

import argparse
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.arguments import add_jobs, add_recordings
from bench.cases.pairs import NOISES, PAIRS, Pair, PairCase, shaken_pair
from bench.hands import find_logs
from bench.metrics import Score, aligned, display, psnr
from bench.pair_scores import PairResult, header, line, summary
from bench.processes import completed, measured
from deshake.files.kernel_file import CameraFile
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import compose
from deshake.pair.denoising import noisy_photo
from deshake.pair.registered_pair import RegisteredPair
from deshake.pair.registration import Registration, registered
from deshake.pictures.sheets import detailed_part
from deshake.run import Run
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.deblurring import Deblurred, deblur
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.methods import RestorationOptions
from deshake.stages.pair_estimate import estimate_pair
from deshake.stages.registering import find_registration

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.cases.photos import Shake
    from deshake.formats.photo import Photo

Image = NDArray[np.float32]

DETAIL = 160  # px, side of the parts that --crops shows
WAYS = ("single", "uniform", "residual", "stopped", "fusion", "true")
NEEDED = {"fusion", "true"}  # by the summary
RESIDUAL = RestorationOptions("residual")
COUNTS = (1, 2, 3, 5, 8, 12)  # of its iterations


def options_of(pair: Pair, *, uniform: bool = False) -> EstimateOptions:
    """Return the options of the estimate: the true camera."""
    return EstimateOptions(
        camera=CameraChoice(file=CameraFile(pair.kernel.camera, "the truth")), uniform=uniform
    )


def own_frame(
    pair: Pair, blurred: Photo, noisy: Photo, registration: Registration, truth: Image
) -> tuple[Image, Image, Image]:
    """Return the noisy photo in its own frame, denoised, and where the blurred one covers it."""
    back = Registration(-registration.theta, 1.0, 1.0, registration.camera)
    g, valid = registered(blurred.pixels, back)
    if pair.curve is None:
        f_N = noisy.pixels * np.float32(truth.mean() / noisy.pixels.mean())
    else:
        turned = RegisteredPair(blurred.with_pixels(g), noisy, back, noisy.pixels, valid)
        f_N = turned.on_curves().f_reg
    own, _ = noisy_photo(g, f_N, lambda image: (image, np.ones_like(valid)), run=Run(1))
    return f_N, np.ascontiguousarray(np.moveaxis(own.denoised, 0, -1)), valid


def blind(case: PairCase, logs: Sequence[Path]) -> Score:
    """Score the blurred photo alone, deblurred blindly."""
    pair = shaken_pair(case, logs)
    photo, _ = pair.photos()
    kernel = estimate_blind(photo, options_of(pair), run=Run(1)).content.kernel
    shown = display(deblur(photo, kernel, run=Run(1)).photo.pixels)
    truth = display(pair.sharp(pair.kernel.centroid))
    return max(Score.of(one, truth) for one in (shown, aligned(shown, truth)))


def best_residual(known: Callable[..., Deblurred], truth: Image, default: Image) -> Image:
    """Return the residual method's result at the best of some numbers of iterations."""
    best = default
    for count in COUNTS:
        light = known(options=RestorationOptions("residual", iterations=count)).photo.pixels
        if psnr(display(light), truth) <= psnr(display(best), truth):
            break
        best = light
    return best


def compare(
    name: str,
    case: PairCase,
    logs: Sequence[Path],
    crops: Path | None,
    wanted: Sequence[str] = WAYS,
) -> PairResult:
    """Make a pair and deblur it by the wanted ways."""
    pair = shaken_pair(case, logs)
    blurred, noisy = pair.photos()
    seconds: dict[str, float] = {}

    def timed(what: str, work: Callable[[], Any]) -> Any:  # noqa: ANN401 - what the work gives
        result, cost = measured(work)
        seconds[what] = cost.cpu
        return result

    options = options_of(pair)
    registering = timed("register", partial(find_registration, blurred, noisy, options, run=Run(1)))
    registration = registering.registration
    frame = compose(pair.theta, -registration.theta)
    kernels = {
        what: timed(
            what,
            partial(
                estimate_pair,
                blurred,
                noisy,
                options_of(pair, uniform=what == "uniform kernel"),
                registration=registration,
                run=Run(1),
            ),
        ).content
        for what in ("kernel", "uniform kernel")
        if what == "kernel" or "uniform" in wanted
    }
    kernel = kernels["kernel"]
    true = pair.kernel
    moved = RotationKernel(compose(-frame, true.theta), true.weights, true.steps, true.camera)
    centred, there, noise = (pair.sharp(at) for at in (true.centroid, frame, pair.theta))
    f_N, f_D, own = own_frame(pair, blurred, noisy, registration, noise)
    results = {
        "blurred": (pair.g, centred),
        "noisy": (f_N, noise),
        "denoised": (f_D, noise),
    }
    if "single" in wanted:
        results["single"] = (deblur(blurred, true, run=Run(1)).photo.pixels, centred)
    ways = {
        "uniform": (kernels.get("uniform kernel", kernel).kernel, RestorationOptions("fusion")),
        "residual": (kernel.kernel, RESIDUAL),
        "fusion": (kernel.kernel, RestorationOptions("fusion")),
        "true": (moved, RestorationOptions("fusion")),
    }
    for what in (way for way in ways if way in wanted):
        chosen, how = ways[what]
        work = partial(
            deblur, blurred, chosen, how, noisy=noisy, registration=registration, run=Run(1)
        )
        results[what] = (timed(what, work).photo.pixels, there)
    known = partial(
        deblur, blurred, kernel.kernel, noisy=noisy, registration=registration, run=Run(1)
    )
    if "stopped" in wanted:
        light = known(options=RESIDUAL).photo.pixels
        results["stopped"] = (best_residual(known, display(there), light), there)
    scores = {}
    for what, (light, sharp) in results.items():
        scores[what] = Score.of(display(light), display(sharp))
    _, valid = registered(noisy.pixels, registration)
    for what, both in (("denoised", own > 0), ("fusion", valid > 0)):
        shown, truth = (display(light) for light in results[what])
        scores[f"{what}, overlap"] = Score.of(shown, truth, both)
    if crops is not None:
        save_crops(crops / f"{name.replace(' ', '-').replace(',', '')}.png", results)
    return PairResult(
        pair.misplaced(frame),
        true.camera.width,
        case.shake.extent,
        registration.confidence,
        kernel.confidence,
        scores,
        seconds,
    )


def save_crops(path: Path, results: dict[str, tuple[Image, Image]]) -> None:
    """Save the part with most detail of all results and of the truth, enlarged twice."""
    truth = results["fusion"][1]
    codes = [np.rint(255 * display(light)).astype(np.uint8) for light, _ in results.values()]
    codes.append(np.rint(255 * display(truth)).astype(np.uint8))
    part = detailed_part(codes[-1], DETAIL, DETAIL)
    strip = np.hstack([picture[part] for picture in codes])[..., ::-1]
    cv2.imwrite(str(path), cv2.resize(strip, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC))


def chosen_cases(text: str) -> list[str]:
    """Read patterns of cases, ``coffee*; *0.06``."""
    patterns = [pattern.strip() for pattern in text.split(";")]
    chosen = [name for name in PAIRS if any(fnmatch(name, pattern) for pattern in patterns)]
    if not chosen:
        raise argparse.ArgumentTypeError(f"{text!r} is not among {'; '.join(PAIRS)}")
    return chosen


def chosen_ways(text: str) -> list[str]:
    """Read names of ways, ``single, uniform``; fusion and true are always among them."""
    named = {way.strip() for way in text.split(",")}
    if unknown := named - set(WAYS):
        raise argparse.ArgumentTypeError(
            f"{', '.join(sorted(unknown))} not among {', '.join(WAYS)}"
        )
    return [way for way in WAYS if way in named | NEEDED]


def blind_scores(cases: Sequence[PairCase], logs: Sequence[Path], jobs: int) -> dict[Shake, Score]:
    """Score every shake of the cases without its noisy photo."""
    lowest = {case.shake: (case._replace(noise=NOISES[0]), logs) for case in cases}
    return dict(completed(blind, lowest, jobs))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_recordings(parser, required=True)
    parser.add_argument(
        "--cases",
        type=chosen_cases,
        default=list(PAIRS),
        help="patterns between semicolons, such as 'coffee*; *0.06'; default: all 36",
    )
    parser.add_argument(
        "--camera-files",
        action="store_true",
        help="through two cameras' tone curves to JPEGs, the short exposure denoised",
    )
    parser.add_argument(
        "--ways", type=chosen_ways, default=list(WAYS), help="of deblurring; default: all"
    )
    parser.add_argument("--blind", action="store_true", help="deblur blindly, too")
    parser.add_argument("--crops", type=Path, metavar="DIR", help="save parts of the results")
    add_jobs(parser, 1)


def run(args: argparse.Namespace) -> int:
    """Run the benchmark: score all cases, some at once, and print each as it is done."""
    logs = find_logs(args.data)
    if args.crops is not None:
        args.crops.mkdir(parents=True, exist_ok=True)
    print(header(blindly=args.blind, ways=args.ways), flush=True)
    cases = {name: PAIRS[name]._replace(camera_files=args.camera_files) for name in args.cases}
    single = blind_scores(list(cases.values()), logs, args.jobs) if args.blind else {}
    tasks = {name: (name, case, logs, args.crops, args.ways) for name, case in cases.items()}
    results: dict[str, PairResult] = {}
    for name, scored in completed(compare, tasks, args.jobs):
        if args.blind:
            scored.scores["blind"] = single[cases[name].shake]
        results[name] = scored
        print(line(name, scored), flush=True)
    print("\n" + summary({name: results[name] for name in cases}))
    return 0
