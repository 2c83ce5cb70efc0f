"""Estimate blindly on photos of known shake, with separate scenes and hands for tuning and tests.

    python scripts/benchmark_shakes.py --cases DIR --scenes DIR [DIR ...] --set tune
    python scripts/benchmark_shakes.py --cases DIR --scenes DIR --only L01,O03 --out rows.json

`shake_cases` has the list of cases and renders them into DIR, without deshake; they stay there. The
sets `tune` and `test` share no scenes and no recordings of hands: settings are chosen on `tune` and
judged on `test`. Photos of .1 to 16 megapixels are shaken by 3 to 120 px. Some are sharp, soft or
out of focus; deblurring should not change them.

Each case is estimated in a process of its own, by default options and with one thread. Its CPU
seconds and peak memory are those of the estimate alone. Photos of up to 1.2 megapixels are
deblurred whole, and of larger ones two parts: that of the most edges, and that of the most near a
corner. PSNR (dB) is that of 8-bit display values over the inner 92 %, after the homography that
fits the sharp photo best: no blind method can know where the camera pointed on average. The photo
itself and the result of the true kernel are scored in the same way, once; DIR keeps these scores
(`*_base.json`: delete them when deblurring changes).

`gain` is the result's lead on the photo, `below` the true kernel's lead on the result. `alike` is
the largest correlation of the kernel's and the truth's local filters over shifts, on average. A
result has a warning if its confidence is below .5 or a note says `doubtful`.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
from arguments import at_least, names
from numpy.typing import NDArray
from shake_cases import CASES, KINDS, MissingError, Places, case_file, is_rendered, render

from deshake.errors import DeshakeError
from deshake.formats.photo import read_photo
from deshake.formats.transfer import Srgb, encode
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import displacements, grid_steps, homographies
from deshake.run import Run
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.deblurring import deblur
from deshake.stages.estimate_options import EstimateOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from multiprocessing.connection import Connection

    from shake_cases import Case

    from deshake.formats.photo import Photo

Codes = NDArray[np.uint8]

WHOLE = 1.2e6  # pixels up to which a photo is deblurred whole
PART = (800, 560)  # px
OUTER = 2 / 3  # of the way from the middle, from which on a part is near a corner
BORDER = 0.04  # of the width, not scored on every side
WORSE = 0.1  # dB
SURE = 0.5
BINS = (0, 0.1, 0.5, 0.9, 1.0001)
POINTS = [0, 2, 4, 6, 8]  # corners and middle of the frame
WORST = 8  # cases listed
COLUMNS = (
    "case  class         MP    px  | photo  result   true    gain  below | alike  extent px"
    "   | conf.  CPU s     MB  verdict"
)


class Box(NamedTuple):
    """A part of a photo, in pixels."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """The part's rows and columns."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def around(self, margin: int, shape: tuple[int, int]) -> Box:
        """The part with a margin, as far as the photo goes."""
        left, top = max(self.x - margin, 0), max(self.y - margin, 0)
        right = min(self.x + self.width + margin, shape[1])
        bottom = min(self.y + self.height + margin, shape[0])
        return Box(left, top, right - left, bottom - top)

    def within(self, other: Box) -> Box:
        """The same part in a crop of the photo."""
        return self._replace(x=self.x - other.x, y=self.y - other.y)


@dataclass(frozen=True)
class Base:
    """What does not depend on the estimate: the parts, PSNR (dB), and the true extent (px)."""

    boxes: list[Box]
    photo: float
    true: float | None = None
    extent: float | None = None


@dataclass(frozen=True)
class Row:
    """The result of a case; PSNR in dB, CPU seconds and megabytes of the estimate."""

    name: str
    kind: str
    scene: str
    megapixels: float
    blur: float
    photo: float
    result: float
    true: float | None
    alike: float | None
    extent: float | None
    true_extent: float | None
    confidence: float
    seconds: float
    megabytes: float
    verdict: str
    notes: list[str] = field(default_factory=list)

    @property
    def gain(self) -> float:
        """The result's lead on the photo."""
        return self.result - self.photo

    @property
    def below(self) -> float | None:
        """The true kernel's lead on the result."""
        return None if self.true is None else self.true - self.result

    @property
    def deblurred(self) -> bool:
        """Whether the photo was changed."""
        return self.verdict == "deblurred"

    @property
    def warned(self) -> bool:
        """Whether the user is warned not to trust the result."""
        return self.confidence < SURE or any("doubtful" in note for note in self.notes)


def in_display(pixels: NDArray[np.float32]) -> Codes:
    """Return 8-bit display values in OpenCV's order; grey becomes colour."""
    codes = encode(np.clip(pixels, 0, 1), Srgb(), 8)
    order = cv2.COLOR_GRAY2BGR if codes.ndim == 2 else cv2.COLOR_RGB2BGR
    return np.asarray(cv2.cvtColor(codes, order))


def softened(codes: Codes) -> NDArray[np.float32]:
    """Return what pictures are aligned by: grey, without noise."""
    grey = cv2.cvtColor(codes, cv2.COLOR_BGR2GRAY).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.5))


def aligned(result: Codes, sharp: Codes) -> NDArray[np.float32]:
    """Align a result with the sharp picture, by a homography."""
    ours, truth = softened(result), softened(sharp)
    window = cv2.createHanningWindow(truth.shape[::-1], cv2.CV_32F)
    (dx, dy), _ = cv2.phaseCorrelate(truth * window, ours * window)
    way = np.array([[1, 0, dx], [0, 1, dy], [0, 0, 1]], np.float32)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-6)
    try:
        _, way = cv2.findTransformECC(truth, ours, way, cv2.MOTION_HOMOGRAPHY, stop)
    except cv2.error:  # nothing fits
        return result.astype(np.float32)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    size = (sharp.shape[1], sharp.shape[0])
    out = cv2.warpPerspective(
        result.astype(np.float32), way, size, None, flags, cv2.BORDER_REPLICATE
    )
    return np.clip(out, 0, 255)


def squared_error(result: Codes, sharp: Codes) -> float:
    """Return the mean squared error of the inner part, aligned or, if that fits better, not."""
    edge = int(BORDER * sharp.shape[1])
    inner = np.s_[edge:-edge, edge:-edge]
    truth = sharp[inner].astype(np.float32)
    either = result.astype(np.float32), aligned(result, sharp)
    return min(float(np.square(one[inner] - truth).mean(dtype=float)) for one in either)


def psnr(errors: Sequence[float]) -> float:
    """PSNR of the mean of squared errors."""
    return float(10 * np.log10(255**2 / max(np.mean(errors), 1e-9)))


def detail_of(sharp: Codes, size: tuple[int, int], blur: float) -> NDArray[np.float64]:
    """Sum up the edges of each part, by its upper left pixel.

    Edges finer than a sixteenth of the blur do not count: nothing restores them.
    """
    grey = cv2.cvtColor(sharp, cv2.COLOR_BGR2GRAY).astype(np.float32)
    grey = cv2.GaussianBlur(grey, (0, 0), 1 + blur / 16)
    edges = np.hypot(*(cv2.Sobel(grey, cv2.CV_32F, dx, 1 - dx) for dx in (0, 1)))
    total = cv2.integral(edges, sdepth=cv2.CV_64F)
    across, down = size
    rows = total[down:] - total[:-down]
    return np.asarray(rows[:, across:] - rows[:, :-across])


def apartness(shape: tuple[int, int], box: Box) -> NDArray[np.float64]:
    """Return the share of each part, by its upper left pixel, that lies outside a box."""
    y, x = (np.arange(side) for side in shape)
    rows = np.clip(1 - np.abs(y - box.y) / box.height, 0, 1)
    columns = np.clip(1 - np.abs(x - box.x) / box.width, 0, 1)
    return 1 - np.outer(rows, columns)


def parts(sharp: Codes, blur: float) -> list[Box]:
    """Choose the parts of a photo to deblur: all, or two parts that hardly overlap."""
    height, width = sharp.shape[:2]
    if height * width <= WHOLE:
        return [Box(0, 0, width, height)]
    size = min(PART[0], width), min(PART[1], height)
    detail = detail_of(sharp, size, blur)
    top, left = divmod(int(detail.argmax()), detail.shape[1])
    first = Box(left, top, *size)
    y, x = (np.abs(np.linspace(-1, 1, side)) >= OUTER for side in detail.shape)
    detail *= (y[:, None] & x) * apartness(detail.shape, first) ** 3
    top, left = divmod(int(detail.argmax()), detail.shape[1])
    return [first, Box(left, top, *size)]


def part_of(photo: Photo, box: Box) -> Photo:
    """Crop a photo."""
    return replace(
        photo,
        pixels=np.ascontiguousarray(photo.pixels[box.slices]),
        clipped=np.ascontiguousarray(photo.clipped[box.slices]),
        alpha=None,
        frame=None,
    )


def score(
    photo: Photo, kernel: RotationKernel | None, sharp: Codes, boxes: Sequence[Box], blur: float
) -> float:
    """Deblur the parts of a photo with a kernel, if there is one, and return the PSNR.

    Half the blur is kept around them, so that what lies beyond them is known.
    """
    errors = []
    for box in boxes:
        wide = box.around(math.ceil(blur / 2), photo.shape)
        part = part_of(photo, wide)
        if kernel is not None:
            camera = kernel.camera.cropped(*wide)
            part = deblur(part, kernel.for_camera(camera), run=Run(1))
        ours = in_display(part.pixels[box.within(wide).slices])
        truth = np.ascontiguousarray(sharp[box.slices])
        errors.append(squared_error(ours, truth))
    return psnr(errors)


def true_kernel(case: Case, folder: Path, photo: Photo) -> RotationKernel | None:
    """Return the kernel that a case was rendered by; None: the camera stood still."""
    if not case.shaken:
        return None
    with np.load(case_file(folder, case, "_path.npz")) as path:
        theta, focal = path["theta"], float(path["f"])
    camera = Camera.from_focal(focal, *photo.shape)
    weights = np.full(len(theta), 1 / len(theta))
    return RotationKernel(theta, weights, grid_steps(camera), camera)


def base_of(case: Case, folder: Path, photo: Photo, sharp: Codes) -> Base:
    """Score the photo itself and the result of the true kernel, or read the stored scores."""
    file = case_file(folder, case, "_base.json")
    if file.is_file():
        stored = json.loads(file.read_text("utf-8"))
        return Base(**stored | {"boxes": [Box(*box) for box in stored["boxes"]]})
    boxes = parts(sharp, case.blur)
    before = score(photo, None, sharp, boxes, case.blur)
    kernel = true_kernel(case, folder, photo)
    base = Base(boxes, before)
    if kernel is not None:
        true = score(photo, kernel, sharp, boxes, case.blur)
        base = Base(boxes, before, true, kernel.extent_px())
    file.write_text(json.dumps(asdict(base)) + "\n", "utf-8")
    return base


def local_filter(
    weights: NDArray[np.float64], moves: NDArray[np.float64], side: int, sigma: float
) -> NDArray[np.float32]:
    """Draw a kernel's filter at a point, smoothed; its norm is 1."""
    image = np.zeros((side, side), np.float32)
    place = moves + side / 2
    corner = np.floor(place).astype(int)
    part = place - corner
    for dx in (0, 1):
        for dy in (0, 1):
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            at = np.clip(corner + np.array([dx, dy]), 0, side - 1)
            np.add.at(image, (at[:, 1], at[:, 0]), weights * share)
    smooth = cv2.GaussianBlur(image, (0, 0), sigma)
    return np.asarray(smooth / np.linalg.norm(smooth))


def similarity(ours: RotationKernel, truth: RotationKernel, extent: float) -> float:
    """Return the largest correlation of two kernels' filters over shifts, on average."""
    sigma = max(0.06 * extent, 0.7)
    peaks = []
    for point in truth.camera.corners[POINTS]:
        drawn = []
        for kernel in (ours, truth):
            moves = displacements(homographies(kernel.camera, kernel.theta), point[None])
            moves = moves.reshape(-1, 2)
            drawn.append((kernel.weights, moves - kernel.weights @ moves))
        far = max(np.abs(moves).max() for _, moves in drawn)
        side = max(int(2 * far + 8 * sigma + 8), 16)
        one, other = (np.fft.rfft2(local_filter(*item, side, sigma)) for item in drawn)
        peaks.append(np.fft.irfft2(one * other.conj(), s=(side, side)).max())
    return float(np.mean(peaks))


def is_still(kernel: RotationKernel) -> bool:
    """Whether a kernel does not change the photo."""
    return not kernel.theta[kernel.weights > 0].any()


def measure(case: Case, folder: Path) -> Row:
    """Estimate a case's kernel, deblur with it, and compare with the truth."""
    cv2.setNumThreads(1)
    photo = read_photo(folder / case.photo)
    options = EstimateOptions(
        camera=CameraChoice(focal_35mm=None if case.quality else float(case.film))
    )
    kernel, confidence, notes, verdict = None, 0.0, [], "left"
    start = time.process_time()
    try:
        blind_estimate = estimate_blind(photo, options, run=Run(1))
        kernel, confidence, notes = (
            blind_estimate.content.kernel,
            blind_estimate.content.confidence,
            blind_estimate.notes,
        )
    except DeshakeError as error:
        verdict = f"error: {error}"
    seconds = time.process_time() - start
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sharp = np.asarray(cv2.imread(str(case_file(folder, case, "_sharp.png"))))
    base = base_of(case, folder, photo, sharp)
    result, alike, extent = base.photo, None, None
    if kernel is not None and not is_still(kernel):
        verdict, extent = "deblurred", kernel.extent_px()
        result = score(photo, kernel, sharp, base.boxes, case.blur)
        truth = true_kernel(case, folder, photo)
        alike = None if truth is None else similarity(kernel, truth, case.blur)
    return Row(
        name=case.name,
        kind=case.kind,
        scene=case.scene,
        megapixels=photo.shape[0] * photo.shape[1] / 1e6,
        blur=case.blur,
        photo=base.photo,
        result=result,
        true=base.true,
        alike=alike,
        extent=extent,
        true_extent=base.extent,
        confidence=confidence,
        seconds=seconds,
        megabytes=megabytes,
        verdict=verdict,
        notes=list(notes),
    )


def prepare(case: Case, folder: Path) -> Base:
    """Score what does not depend on the estimate."""
    cv2.setNumThreads(1)
    photo = read_photo(folder / case.photo)
    sharp = np.asarray(cv2.imread(str(case_file(folder, case, "_sharp.png"))))
    return base_of(case, folder, photo, sharp)


def send(pipe: Connection, function: Callable[..., Any], args: Sequence[Any]) -> None:
    """Send what a function returns, or its exception."""
    try:
        pipe.send(function(*args))
    except Exception as error:  # noqa: BLE001 - the other process raises it
        pipe.send(error)
    pipe.close()


def apart(function: Callable[..., Any], *args: Any) -> Any:  # noqa: ANN401
    """Call a function in a process of its own; raise what it raises."""
    context = get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=send, args=(theirs, function, args))
    process.start()
    theirs.close()
    try:
        answer = ours.recv()
    except EOFError:
        answer = RuntimeError("its process was killed")
    process.join()
    if isinstance(answer, Exception):
        raise answer
    return answer


def run(case: Case, args: argparse.Namespace, places: Places) -> Row | Base:
    """Render a case, unless it is there, and measure it."""
    if not is_rendered(case, args.cases):
        apart(render, case, args.set, places, args.cases)
    return apart(prepare if args.render_only else measure, case, args.cases)


def number(value: float | None, form: str) -> str:
    """Format a number, or a dash in its place."""
    width = int(form.split(".", maxsplit=1)[0].lstrip("+"))
    return "-".rjust(width) if value is None else format(value, form)


def line(row: Row) -> str:
    """One case."""
    extent = f"{number(row.extent, '5.1f')} /{number(row.true_extent, '6.1f')}"
    remark = row.notes[0][:60] if row.notes and row.true is None else ""
    verdict = row.verdict + (", warned" if row.warned and row.deblurred else "")
    return (
        f"{row.name:5} {row.kind:12} {row.megapixels:5.2f} {row.blur:5.1f}"
        f"  | {row.photo:5.2f}  {row.result:6.2f}  {number(row.true, '5.2f')}"
        f"  {row.gain:+6.2f}  {number(row.below, '5.2f')} | {number(row.alike, '5.3f')}"
        f"  {extent}  | {row.confidence:5.3f}  {row.seconds:5.1f}  {row.megabytes:5.0f}"
        f"  {verdict}{'; ' if remark else ''}{remark}"
    )


def spread(values: Sequence[float], form: str, worst: Callable[[Sequence[float]], float]) -> str:
    """Mean, median and worst."""
    return " ".join(
        format(one, form) for one in (np.mean(values), np.median(values), worst(values))
    )


def class_table(rows: Sequence[Row]) -> list[str]:
    """Gain, distance from the true kernel and cost of each class."""
    head = (
        f"{'class':13} {'n':>3} {'left':>4} |{'gain: mean, median, worst':>26} |"
        f"{'below: mean, median, worst':>27} |{'CPU: mean, median, worst':>26}"
    )
    lines = [head]
    for kind in KINDS.values():
        some = [row for row in rows if row.kind == kind]
        if not some:
            continue
        below = [row.below for row in some if row.below is not None]
        lines.append(
            f"{kind:13} {len(some):3} {sum(not row.deblurred for row in some):4} |"
            f" {spread([row.gain for row in some], '+7.2f', min):>25} |"
            f" {spread(below, '7.2f', max) if below else '-':>26} |"
            f" {spread([row.seconds for row in some], '7.1f', max):>25}"
        )
    return lines


def unwarned_table(rows: Sequence[Row]) -> list[str]:
    """Count the photos that become worse without a warning."""
    lines = [f"made worse by more than {WORSE} dB without a warning:"]
    for kind in KINDS.values():
        some = [row for row in rows if row.kind == kind]
        worse = [row.name for row in some if row.gain < -WORSE and not row.warned]
        if some:
            lines.append(f"  {kind:13} {len(worse)} of {len(some)}  {' '.join(worse)}")
    return lines


def reliability_table(rows: Sequence[Row]) -> list[str]:
    """Compare the confidence of results with how many of them are better than their photos."""
    lines = ["confidence  deblurred, shaken: better   deblurred, not shaken: better"]
    for low, high in pairwise(BINS):
        cells = []
        for shaken in (True, False):
            some = [
                row
                for row in rows
                if row.deblurred
                and low <= row.confidence < high
                and (row.true is not None) == shaken
            ]
            better = sum(row.gain > 0 for row in some)
            share = f"{100 * better / len(some):4.0f} %" if some else "     -"
            cells.append(f"{len(some):18} {share:>8}")
        lines.append(f"{low:3.1f} to {min(high, 1):3.1f} {'    '.join(cells)}")
    return lines


def worst_cases(rows: Sequence[Row]) -> list[str]:
    """List the smallest gains, and the largest distances from the true kernel."""
    by_gain = sorted(rows, key=lambda row: row.gain)[:WORST]
    shaken = [row for row in rows if row.below is not None]
    by_distance = sorted(shaken, key=lambda row: -(row.below or 0))[:WORST]
    return [
        "smallest gains: " + ", ".join(f"{row.name} {row.gain:+.2f}" for row in by_gain),
        "farthest below the true kernel: "
        + ", ".join(f"{row.name} {row.below:.2f}" for row in by_distance),
    ]


def report(rows: Sequence[Row]) -> str:
    """All tables."""
    tables = (class_table, unwarned_table, reliability_table, worst_cases)
    return "\n\n".join("\n".join(table(rows)) for table in tables)


def dump(rows: Sequence[Row], file: Path) -> None:
    """Write all rows as JSON."""
    records = [asdict(row) | {"gain": row.gain, "below": row.below} for row in rows]
    file.write_text(json.dumps(records, indent=1) + "\n", "utf-8")


def at_hand(cases: Sequence[Case], args: argparse.Namespace, places: Places) -> list[Case]:
    """Return the cases that are rendered or can be; say what is missing for the others."""
    out: list[Case] = []
    missing: dict[str, list[str]] = {}
    for case in cases:
        try:
            if not is_rendered(case, args.cases):
                places.check(case, args.set)
            out.append(case)
        except MissingError as error:
            missing.setdefault(str(error), []).append(case.name)
    for what, left_out in missing.items():
        print(f"{what} (left out: {', '.join(left_out)})", file=sys.stderr)
    return out


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    known = [case.name for cases in CASES.values() for case in cases]
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--data", type=Path, default=Path("../shared/data"), help="folder of the test data"
    )
    parser.add_argument(
        "--scenes", type=Path, nargs="+", default=[], help="more folders in which scenes may be"
    )
    parser.add_argument(
        "--cases", type=Path, required=True, help="folder of rendered cases, which stay there"
    )
    parser.add_argument("--set", choices=tuple(CASES), default="tune", help="default: tune")
    parser.add_argument(
        "--only", type=partial(names, known=known), help="names, separated by commas; default: all"
    )
    parser.add_argument(
        "--jobs", type=partial(at_least, 1), default=1, help="processes at once; default: 1"
    )
    parser.add_argument(
        "--render-only", action="store_true", help="render, and score photos and true kernels"
    )
    parser.add_argument("--out", type=Path, help="file for all rows, as JSON")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    args = parse(argv)
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    places = Places(args.data, args.scenes)
    wanted = [case for case in CASES[args.set] if args.only is None or case.name in args.only]
    if not wanted:
        print(f"none of --only is among the cases of --set {args.set}", file=sys.stderr)
    cases = at_hand(wanted, args, places)
    rows: list[Row] = []
    failed = 0
    if not args.render_only:
        print(COLUMNS, flush=True)
    with ThreadPoolExecutor(args.jobs) as pool:
        running = {pool.submit(run, case, args, places): case for case in cases}
        for future in as_completed(running):
            name = running[future].name
            try:
                row = future.result()
            except Exception as error:  # noqa: BLE001 - the other cases go on
                print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr)
                failed += 1
                continue
            if isinstance(row, Base):
                print(f"{name}: photo {row.photo:.2f}, true {number(row.true, '5.2f')}", flush=True)
                continue
            rows.append(row)
            print(line(row), flush=True)
            if args.out is not None:
                dump(rows, args.out)
    if rows:
        print("\n" + report(rows))
    return 1 if failed or not cases else 0


if __name__ == "__main__":
    sys.exit(main())
