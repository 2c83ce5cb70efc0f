"""Compare the methods of deblurring on real photos with simulated shake, against the truth.

    python scripts/benchmark_restoration.py --data DIR
    python scripts/benchmark_restoration.py --cases "coffee,rocket night" --kernels true --crops out

DIR, or its folder nexus5, holds orientation logs of a hand-held phone (`hand_shakes`); without it
the cases that are shaken by hands are left out. `shaken_photos` describes the cases.

The table has PSNR (dB) and SSIM of display values over the whole frame, border included: of the
blurred photo, of plain Richardson-Lucy at the number of iterations with the best PSNR, which needs
the truth, and of each method. For the default it also has: its processor time over that of 20 plain
iterations; how much worse its outer 16 pixels are than the rest; its noise over the photo's where
the truth is flattest; and the largest change of a channel's mean, in percent.

The kernel is that of the path (true), or one with errors like those of an estimate (wrong).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from hand_shakes import find_logs
from numpy.typing import NDArray
from shaken_photos import CASES, Case, display, psnr, shaken, ssim, wrong

from deshake.errors import DeshakeError
from deshake.restore.richardson_lucy import richardson_lucy, richardson_lucy_tv
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run

if TYPE_CHECKING:
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


class Score(NamedTuple):
    """PSNR (dB), SSIM and processor seconds of a method."""

    psnr: float
    ssim: float
    seconds: float


class Row(NamedTuple):
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
    shown = display(pixels)
    return pixels, Score(psnr(shown, truth), ssim(shown, truth), seconds)


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
    task: tuple[str, Case, str], logs: Sequence[Path], methods: Sequence[str], crops: Path | None
) -> Row:
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
    return Row(
        Score(psnr(before, as_is), ssim(before, as_is), 0),
        count,
        best,
        {name: method_score for name, (_, method_score) in done.items()},
        score.seconds / timed,
        border_loss(shown, truth),
        flat_noise(shown, before, truth),
        float(100 * np.abs(means - 1).max()),
    )


def line(name: str, row: Row) -> str:
    """One case of the table."""
    cells = [name, f"{row.blurred.psnr:.2f}/{row.blurred.ssim:.3f}"]
    cells.append(f"{row.best.psnr:.2f}/{row.best.ssim:.3f} ({row.count})")
    cells += [f"{score.psnr:.2f}/{score.ssim:.3f}" for score in row.methods.values()]
    cells += [f"{row.slower:.2f}", f"{row.border:+.1f}", f"{row.noise:.2f}"]
    return "| " + " | ".join([*cells, f"{row.brightness:.2f}"]) + " |"


def header(methods: Sequence[str]) -> str:
    """Head of the table."""
    cells = ["case", "blurred", "best plain", *methods, "time", "border", "noise", "mean %"]
    return "| " + " | ".join(cells) + " |\n" + "|---" * len(cells) + "|"


def summary(rows: Sequence[Row]) -> str:
    """Mean and least gains of each method over plain iterations at their best."""
    lines = []
    for name in rows[0].methods:
        gains = np.array(
            [
                (row.methods[name].psnr - row.best.psnr, row.methods[name].ssim - row.best.ssim)
                for row in rows
            ]
        )
        seconds = sum(row.methods[name].seconds for row in rows)
        (p, s), (least_p, least_s) = gains.mean(0), gains.min(0)
        lines.append(
            f"{name}: {p:+.2f} dB, {s:+.3f}; least {least_p:+.2f}, {least_s:+.3f}; {seconds:.0f} s"
        )
    lines.append(f"default: time {np.mean([row.slower for row in rows]):.2f}")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the comparison."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = partial(str.split, sep=",")
    parser.add_argument("--data", type=Path, help="folder of orientation logs")
    parser.add_argument("--cases", type=names, default=list(CASES), help="default: all")
    parser.add_argument("--methods", type=names, default=list(METHODS), help="default: all")
    parser.add_argument("--kernels", type=names, default=["true"], help="default: true")
    parser.add_argument("--seed", type=int, default=0, help="added to every case's; default: 0")
    parser.add_argument("--jobs", type=int, default=2, help="cases at once; default: 2")
    parser.add_argument("--crops", type=Path, help="folder for the pictures, side by side")
    args = parser.parse_args(argv)
    try:
        logs = find_logs(args.data) if args.data else []
        for known, given in ((CASES, args.cases), (METHODS, args.methods), (KERNELS, args.kernels)):
            if unknown := set(given) - set(known):
                raise DeshakeError(  # noqa: TRY301
                    f"{unknown.pop()!r} is not among {', '.join(known)}"
                )
    except DeshakeError as error:
        print(f"error: {error}\nhint: {error.hint or 'see --help'}", file=sys.stderr)
        return 1
    cases = {name: CASES[name]._replace(seed=CASES[name].seed + args.seed) for name in args.cases}
    if not logs and any(case.hand for case in cases.values()):
        print("no --data: the cases shaken by hands are left out", file=sys.stderr)
        cases = {name: case for name, case in cases.items() if not case.hand}
    if args.crops:
        args.crops.mkdir(parents=True, exist_ok=True)
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    work = partial(compare, logs=logs, methods=args.methods, crops=args.crops)
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for kind in args.kernels:
            print(f"\nkernel: {kind}\n\n{header(args.methods)}", flush=True)
            rows = {}
            tasks = [(name, case, kind) for name, case in cases.items()]
            for (name, _, _), row in zip(tasks, pool.map(work, tasks), strict=True):
                rows[name] = row
                print(line(name, row), flush=True)
            for title, night in (("unclipped", False), ("clipped lights", True)):
                chosen = [row for name, row in rows.items() if cases[name].night is night]
                if chosen:
                    print(f"\n{title}, over plain at its best:\n{summary(chosen)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
