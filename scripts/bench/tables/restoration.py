"""Compare the methods of deblurring on real photos with simulated shake, against the truth.

    python scripts/bench.py restoration --data DIR
    python scripts/bench.py restoration --cases "coffee,rocket night" --kernels true --crops out

DIR, or its folder nexus5, holds orientation logs of a hand-held phone (`bench.hands`); without it
the cases that are shaken by hands are left out. `bench.cases.photos` describes the cases.

The table has PSNR (dB) and SSIM of display values over the whole frame, border included: of the
blurred photo, of plain Richardson-Lucy at the number of iterations with the best PSNR, which needs
the truth, and of each method. For the default it also has: its processor time over that of 20 plain
iterations; how much worse its outer 16 pixels are than the rest; its noise over the photo's where
the truth is flattest; and the largest change of a channel's mean, in percent.

The kernel is that of the path (true), or one with errors like those of an estimate (wrong).
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.arguments import add_jobs, add_recordings, names
from bench.cases.photos import CASES, Shake, shaken, wrong
from bench.errors import MissingDataError
from bench.hands import find_logs
from bench.markdown import head, row
from bench.metrics import Score, display
from deshake.restore.richardson_lucy import richardson_lucy, richardson_lucy_tv
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from deshake.restore.restoration import Restoration

Image = NDArray[np.float32]

METHODS: dict[str, Callable[..., Restoration]] = {
    "rl": richardson_lucy,
    "rl-tv": richardson_lucy_tv,
    "fast": partial(sparse_gradients, quality="fast"),
    "default": sparse_gradients,
    "high": partial(sparse_gradients, quality="high"),
}
KERNELS = ("true", "wrong")
COUNTS = (2, 3, 5, 7, 10, 14, 20, 28, 40, 56, 80, 112)  # of plain iterations
PAST = 0.3  # dB below the best count so far: a larger loss ends the search
TIMED = 20
BORDER = 16


class Result(NamedTuple):
    """A case: the photo, plain iterations at their best, the methods, more of the default."""

    blurred: Score
    count: int
    best: Score
    methods: dict[str, Score]
    slower: float
    border: float
    noise: float
    brightness: float


def restore(method: Callable[[], Restoration], truth: Image) -> tuple[Image, Score]:
    """Deblur; return the light and its score."""
    start = time.process_time()
    pixels = method().pixels
    seconds = time.process_time() - start
    return pixels, Score.of(display(pixels), truth)._replace(seconds=seconds)


def best_plain(plain: Callable[[int], Restoration], truth: Image) -> tuple[int, Score, float]:
    """Find the best number of plain iterations; return also the time of `TIMED` of them."""
    scores: dict[int, Score] = {}
    timed = 0.0
    for count in COUNTS:
        scores[count] = restore(partial(plain, count), truth)[1]
        timed = scores[count].seconds * TIMED / count
        if count >= TIMED and scores[count].psnr < max(s.psnr for s in scores.values()) - PAST:
            break
    best = max(scores, key=lambda count: scores[count].psnr)
    return best, scores[best], scores[TIMED].seconds if TIMED in scores else timed


def border_loss(shown: Image, truth: Image) -> float:
    """How much less PSNR the outer pixels have than the rest, in dB."""
    error = np.square(shown - truth).mean(-1, dtype=np.float64)
    outer = np.ones(error.shape, bool)
    outer[BORDER:-BORDER, BORDER:-BORDER] = False
    return float(10 * np.log10(error[outer].mean() / error[~outer].mean()))


def flat_noise(shown: Image, photo: Image, truth: Image) -> float:
    """Noise over the photo's, in the tenth of the frame where the truth is flattest."""

    def fine(image: Image) -> Image:
        return np.square(image - cv2.GaussianBlur(image, (0, 0), 2)).sum(-1)

    texture = cv2.GaussianBlur(fine(truth), (0, 0), 4)
    flat = texture < np.quantile(texture, 0.1)
    return float(np.sqrt(fine(shown)[flat].mean() / fine(photo)[flat].mean()))


def compare(
    task: tuple[str, Shake, str], logs: Sequence[Path], methods: Sequence[str], crops: Path | None
) -> Result:
    """Shake a photo and deblur it by each method."""
    name, case, kind = task
    photo = shaken(case, logs)
    kernel = photo.kernel if kind == "true" else wrong(photo.kernel, case.seed)
    truth = display(photo.sharp(kernel.centroid))
    before = display(photo.pixels)
    as_is = display(photo.sharp(np.zeros(3)))
    known = partial(richardson_lucy, photo.pixels, kernel, run=Run(1))
    count, best, timed = best_plain(lambda n: known(iterations=n, accelerated=False), truth)
    done = {
        name: restore(
            partial(METHODS[name], photo.pixels, kernel, clipped=photo.clipped, run=Run(1)), truth
        )
        for name in methods
    }
    pixels, score = done.get("default") or next(iter(done.values()))
    shown = display(pixels)
    if crops is not None:
        plain = display(known(iterations=count, accelerated=False).pixels)
        pictures = [before, plain, *(display(light) for light, _ in done.values()), truth]
        side = np.hstack(pictures)[..., ::-1] * 255
        cv2.imwrite(str(crops / f"{name.replace(' ', '-')}-{kind}.png"), np.rint(side))
    means = pixels.mean((0, 1), dtype=float) / photo.pixels.mean((0, 1), dtype=float)
    return Result(
        Score.of(before, as_is),
        count,
        best,
        {name: method_score for name, (_, method_score) in done.items()},
        score.seconds / timed,
        border_loss(shown, truth),
        flat_noise(shown, before, truth),
        float(100 * np.abs(means - 1).max()),
    )


def line(name: str, result: Result) -> str:
    """One case of the table."""
    cells = [name, result.blurred, f"{result.best} ({result.count})", *result.methods.values()]
    cells += [f"{result.slower:.2f}", f"{result.border:+.1f}", f"{result.noise:.2f}"]
    return row([*cells, f"{result.brightness:.2f}"])


def header(methods: Sequence[str]) -> str:
    """Head of the table."""
    return head(["case", "blurred", "best plain", *methods, "time", "border", "noise", "mean %"])


def summary(results: Sequence[Result]) -> str:
    """Mean and least gains of each method over plain iterations at their best."""
    lines = []
    for name in results[0].methods:
        gains = np.array(
            [np.subtract(result.methods[name][:2], result.best[:2]) for result in results]
        )
        seconds = sum(result.methods[name].seconds for result in results)
        (p, s), (least_p, least_s) = gains.mean(0), gains.min(0)
        lines.append(
            f"{name}: {p:+.2f} dB, {s:+.3f}; least {least_p:+.2f}, {least_s:+.3f}; {seconds:.0f} s"
        )
    lines.append(f"default: time {np.mean([result.slower for result in results]):.2f}")
    return "\n".join(lines)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_recordings(parser, required=False)
    cases, methods, kernels = (partial(names, known=list(one)) for one in (CASES, METHODS, KERNELS))
    parser.add_argument("--cases", type=cases, default=list(CASES), help="default: all")
    parser.add_argument("--methods", type=methods, default=list(METHODS), help="default: all")
    parser.add_argument("--kernels", type=kernels, default=["true"], help="default: true")
    parser.add_argument("--seed", type=int, default=0, help="added to every case's; default: 0")
    add_jobs(parser, 2)
    parser.add_argument("--crops", type=Path, help="folder for the pictures, side by side")


def run(args: argparse.Namespace) -> int:
    """Run the comparison."""
    logs = find_logs(args.data) if args.data else []
    cases = {name: CASES[name]._replace(seed=CASES[name].seed + args.seed) for name in args.cases}
    if not logs and any(case.hand for case in cases.values()):
        print("no --data: the cases shaken by hands are left out", file=sys.stderr)
        cases = {name: case for name, case in cases.items() if not case.hand}
    if not cases:
        raise MissingDataError("all these cases are shaken by hands; --data names the recordings")
    if args.crops:
        args.crops.mkdir(parents=True, exist_ok=True)
    work = partial(compare, logs=logs, methods=args.methods, crops=args.crops)
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for kind in args.kernels:
            print(f"\nkernel: {kind}\n\n{header(args.methods)}", flush=True)
            rows = {}
            tasks = [(name, case, kind) for name, case in cases.items()]
            for (name, _, _), scored in zip(tasks, pool.map(work, tasks), strict=True):
                rows[name] = scored
                print(line(name, scored), flush=True)
            for title, night in (("unclipped", False), ("clipped lights", True)):
                chosen = [scored for name, scored in rows.items() if cases[name].night is night]
                if chosen:
                    print(f"\n{title}, over plain at its best:\n{summary(chosen)}", flush=True)
    return 0
