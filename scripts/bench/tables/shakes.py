"""Estimate blindly on photos of known shake, with separate scenes and hands for tuning and tests.

    python scripts/bench.py shakes --cases DIR --scenes DIR [DIR ...] --set tune
    python scripts/bench.py shakes --cases DIR --scenes DIR --only L01,O03 --out rows.json

`bench.cases.shakes` has the list of cases; they are rendered into DIR, without deshake, and stay
there. The sets `tune` and `test` share no scenes and no recordings of hands: settings are chosen on
`tune` and judged on `test`. Photos of .1 to 16 megapixels are shaken by 3 to 120 px. Some are
sharp, soft or out of focus; deblurring should not change them.

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

With `--focal auto` or a number of mm, the estimate does not know the true focal length. With
`--camera` the photos are those of a camera that interpolates colours, smooths noise, applies a tone
curve and sharpens (`bench.cases.camera_files`).
"""

from __future__ import annotations

import json
import math
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.arguments import add_jobs, names
from bench.cases.camera_files import CAMERA
from bench.cases.rendering import PLAIN, is_rendered, render
from bench.cases.scenes import Places
from bench.cases.shakes import CASES, case_file
from bench.errors import MissingDataError
from bench.kernel_likeness import similarity
from bench.metrics import decibels, projected
from bench.photo_parts import Box, part_of, parts
from bench.processes import apart, peak_bytes
from bench.shake_report import COLUMNS, Row, dump, line, number, report
from deshake.errors import DeshakeError
from deshake.formats.photo import read_photo
from deshake.formats.transfer import Srgb, encode
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.run import Run
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.deblurring import deblur, in_linear_tones
from deshake.stages.estimate_options import EstimateOptions

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from bench.cases.shakes import Case
    from deshake.formats.photo import Photo

Codes = NDArray[np.uint8]

BORDER = 0.04  # of the width, not scored on every side


@dataclass(frozen=True)
class Base:
    """What does not depend on the estimate: the parts, PSNR (dB), and the true extent (px)."""

    boxes: list[Box]
    photo: float
    true: float | None = None
    extent: float | None = None


def in_display(pixels: NDArray[np.float32]) -> Codes:
    """Return 8-bit display values in OpenCV's order; grey becomes colour."""
    codes = encode(np.clip(pixels, 0, 1), Srgb(), 8)
    order = cv2.COLOR_GRAY2BGR if codes.ndim == 2 else cv2.COLOR_RGB2BGR
    return np.asarray(cv2.cvtColor(codes, order))


def squared_error(result: Codes, sharp: Codes) -> float:
    """Return the mean squared error of the inner part, aligned or, if that fits better, not."""
    edge = int(BORDER * sharp.shape[1])
    inner = np.s_[edge:-edge, edge:-edge]
    truth = sharp[inner].astype(np.float32)
    either = result.astype(np.float32), projected(result, sharp)
    return min(float(np.square(one[inner] - truth).mean(dtype=float)) for one in either)


def score(
    photo: Photo, kernel: RotationKernel | None, sharp: Codes, boxes: Sequence[Box], blur: float
) -> float:
    """Deblur the parts of a photo with a kernel, if there is one, and return the PSNR.

    Half the blur is kept around them, so that what lies beyond them is known. The whole photo
    decides whether they are deblurred in linear light or in display values.
    """
    errors = []
    toned = photo if kernel is None else in_linear_tones(photo, kernel)
    for box in boxes:
        wide = box.around(math.ceil(blur / 2), photo.shape)
        part = part_of(toned, wide)
        if kernel is not None:
            camera = kernel.camera.cropped(*wide)
            part = deblur(part, kernel.for_camera(camera), run=Run(1)).photo
        ours = in_display(part.with_tones_of(photo).pixels[box.within(wide).slices])
        truth = np.ascontiguousarray(sharp[box.slices])
        errors.append(squared_error(ours, truth))
    return decibels(max(np.mean(errors), 1e-9), peak=255)


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


def camera_of(case: Case, focal: str) -> CameraChoice:
    """Return the choice of a camera: the true one, one of `focal` mm, or one to be estimated."""
    if focal == "auto":
        return CameraChoice(focal="auto")
    if focal == "true":
        return CameraChoice(focal_35mm=None if case.quality else float(case.film))
    return CameraChoice(focal_35mm=float(focal))


def measure(case: Case, folder: Path, focal: str = "true") -> Row:
    """Estimate a case's kernel, deblur with it, and compare with the truth."""
    cv2.setNumThreads(1)
    photo = read_photo(folder / case.photo)
    options = EstimateOptions(camera=camera_of(case, focal))
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
    megabytes = peak_bytes() / 2**20
    sharp = np.asarray(cv2.imread(str(case_file(folder, case, "_sharp.png"))))
    base = base_of(case, folder, photo, sharp)
    result, alike, extent = base.photo, None, None
    if kernel is not None and not kernel.is_still:
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


def run_case(case: Case, args: argparse.Namespace, places: Places) -> Row | Base:
    """Render a case, unless it is there, and measure it."""
    if not is_rendered(case, args.cases, args.way):
        apart(render, case, args.set, places, args.cases, args.way)
    if args.render_only:
        return apart(prepare, case, args.cases)
    return apart(measure, case, args.cases, args.focal)


def at_hand(cases: Sequence[Case], args: argparse.Namespace, places: Places) -> list[Case]:
    """Return the cases that are rendered or can be; say what is missing for the others."""
    out: list[Case] = []
    missing: dict[str, list[str]] = {}
    for case in cases:
        try:
            if not is_rendered(case, args.cases, args.way):
                places.check(case, args.set)
            out.append(case)
        except MissingDataError as error:
            missing.setdefault(str(error), []).append(case.name)
    for what, left_out in missing.items():
        print(f"{what} (left out: {', '.join(left_out)})", file=sys.stderr)
    return out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    known = [case.name for cases in CASES.values() for case in cases]
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
    add_jobs(parser, 1)
    parser.add_argument(
        "--render-only", action="store_true", help="render, and score photos and true kernels"
    )
    parser.add_argument(
        "--focal",
        choices=("true", "auto", "28", "50", "100"),
        default="true",
        help="focal length: the true one, estimated, or so many mm; default: true",
    )
    parser.add_argument(
        "--camera",
        action="store_const",
        const=CAMERA,
        default=PLAIN,
        dest="way",
        help="render the photos as a camera writes them",
    )
    parser.add_argument("--out", type=Path, help="file for all rows, as JSON")


def run(args: argparse.Namespace) -> int:
    """Run the benchmark."""
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
        running = {pool.submit(run_case, case, args, places): case for case in cases}
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
