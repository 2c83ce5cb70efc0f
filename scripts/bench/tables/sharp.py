"""Fix photos that were not shaken, or are out of focus: they must not be made worse.

    python scripts/bench.py sharp
    python scripts/bench.py sharp --cases "coffee,coffee jpeg 75" --data DIR

Sharp photos are those that a development dependency ships, at their own size: as they are, as
JPEGs, with noise, in parts, by night, with smooth skies, and pages of text. With `--data` two
more are looked for in that folder, houses.jpg and manmade_01.png. A result is to differ from its
photo by less than 0.5 % rms of full scale, in display values, or not at all, with a note that says
why.

Photos out of focus are blurred in linear light by a disk of 3 to 15 pixels across, with noise, as
8-bit files. The table has the PSNR (dB) of display values before and after, at the shift and turn
that fit best; none may lose more than 0.1 dB. The last column is the note of the estimate.
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures

from bench.arguments import names
from bench.cases.rendering import disk
from bench.cases.shipped import SHIPPED
from bench.errors import MissingDataError
from bench.markdown import head, row
from bench.metrics import aligned_psnr, display
from bench.processes import measured
from deshake.formats.photo import Photo, read_photo
from deshake.formats.transfer import Srgb, decode, encode
from deshake.run import Run
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.deblurring import deblur
from deshake.stages.estimate_options import EstimateOptions

if TYPE_CHECKING:
    import argparse

    from deshake.stages.estimate_result import Estimate

Codes = NDArray[np.uint8]
Image = NDArray[np.float32]

TO_FIND = {"houses": "houses.jpg", "manmade": "manmade_01.png"}  # in the folder of data
LONGEST = 1024  # px: longer side; larger photos of that folder are reduced to it
MOST_RMS = 0.005  # of full scale
MOST_LOST = 0.1  # dB
BORDER = 12  # px left out of the comparison on every side


class Change(NamedTuple):
    """How a photo is changed before it is fixed.

    Light is multiplied by `light`, blurred by a disk so many pixels across, and given noise of so
    much of full scale; `part` is a share of the frame (top, bottom, left, right).
    """

    photo: str
    quality: int | None = None
    sigma: float = 0.0
    part: tuple[float, float, float, float] = (0, 1, 0, 1)
    light: float = 1.0
    disk: float = 0.0


SHARP = {
    **{name: Change(name) for name in SHIPPED if name != "retina"},
    **{f"{name} jpeg 75": Change(name, 75) for name in ("astronaut", "coffee", "camera", "page")},
    **{f"{name} jpeg 85": Change(name, 85) for name in ("china", "motorcycle", "chelsea")},
    **{f"{name} jpeg 95": Change(name, 95) for name in ("astronaut", "flower")},
    **{f"{name} noise": Change(name, 92, 0.01) for name in ("astronaut", "coffee", "rocket")},
    **{f"{name} strong noise": Change(name, 92, 0.03) for name in ("astronaut", "china")},
    "astronaut part": Change("astronaut", part=(0, 0.55, 0.2, 0.75)),
    "china roofs": Change("china", part=(0.3, 0.9, 0.3, 0.9)),
    "coffee part": Change("coffee", 90, part=(0.2, 0.9, 0.1, 0.6)),
    "motorcycle part": Change("motorcycle", part=(0.3, 1, 0.1, 0.6)),
    "china sky": Change("china", 90, part=(0, 0.55, 0, 1)),
    "rocket sky": Change("rocket", 90, part=(0, 0.6, 0, 1)),
    "china night": Change("china", 92, 0.01, light=0.1),
    "motorcycle night": Change("motorcycle", 92, 0.005, light=0.1),
    "astronaut overexposed": Change("astronaut", 92, 0.005, light=2.5),
}
AT_HAND = {name: Change(name) for name in TO_FIND}
UNFOCUSED = {
    f"{name} disk {disk:g}": Change(name, quality, sigma, disk=disk)
    for name, disk, quality, sigma in [
        ("astronaut", 3, None, 0.005),
        ("astronaut", 5, 92, 0.01),
        ("astronaut", 9, None, 0.005),
        ("astronaut", 15, 92, 0.01),
        ("coffee", 4, 92, 0.01),
        ("coffee", 7, None, 0.005),
        ("coffee", 12, 92, 0.005),
        ("motorcycle", 3, 92, 0.005),
        ("motorcycle", 6, None, 0.01),
        ("motorcycle", 10, 92, 0.005),
        ("china", 5, None, 0.005),
        ("china", 8, 92, 0.01),
        ("camera", 6, 92, 0.005),
        ("chelsea", 6, None, 0.005),
        ("rocket", 8, 92, 0.005),
    ]
}
CASES = SHARP | AT_HAND | UNFOCUSED


class Result(NamedTuple):
    """How different the result is (of full scale), PSNR before and after (dB), and what is said."""

    rms: float
    before: float
    after: float
    confidence: float
    seconds: float
    notes: list[str]
    left: bool


def read(name: str, folder: Path | None) -> Codes:
    """Read a photo; raise MissingDataError where it is not in the folder."""
    if name in SHIPPED:
        return np.ascontiguousarray(SHIPPED[name]())
    places = [] if folder is None else sorted(folder.rglob(TO_FIND[name]))
    if not places:
        raise MissingDataError(f"no {TO_FIND[name]}; --data names its folder")
    picture = Pictures.open(places[0]).convert("RGB")
    picture.thumbnail((LONGEST, LONGEST), Pictures.Resampling.BOX)
    return np.asarray(picture)


def prepare(change: Change, folder: Path | None, path: Path) -> tuple[Path, Image]:
    """Write the photo of a case under a name without an ending; return it and the truth."""
    codes = read(change.photo, folder)
    height, width = codes.shape[:2]
    top, bottom, left, right = change.part
    codes = codes[
        round(top * height) : round(bottom * height), round(left * width) : round(right * width)
    ]
    if change.sigma == change.disk == 0 and change.light == 1:
        stored = codes  # to the code
    else:
        light = decode(codes, Srgb()) * np.float32(change.light)
        if change.disk:
            light = cv2.filter2D(
                light, -1, disk(change.disk / 2, fine=8), borderType=cv2.BORDER_REFLECT
            )
        grain = np.random.default_rng(len(change.photo)).standard_normal(light.shape)
        shown = Srgb().from_linear(np.clip(light, 0, 1)) + change.sigma * grain
        stored = np.rint(255 * np.clip(shown, 0, 1)).astype(np.uint8)
    path = path.with_suffix(".png" if change.quality is None else ".jpg")
    options = {} if change.quality is None else {"quality": change.quality}
    Pictures.fromarray(stored).save(path, **options)
    return path, decode(codes, Srgb())


def fit(photo: Photo, truth: Image) -> float:
    """PSNR of display values at the shift and turn that fit best."""
    image, sharp = display(photo.pixels), display(truth)
    if image.ndim == 2:
        image, sharp = (np.repeat(one[..., None], 3, 2) for one in (image, sharp))
    return aligned_psnr(image, sharp, BORDER)


def measure(change: Change, folder: Path | None) -> Result:
    """Fix the photo of a case by default."""
    with tempfile.TemporaryDirectory() as scratch:
        path, truth = prepare(change, folder, Path(scratch) / "photo")
        photo = read_photo(path)

    def fix() -> tuple[Estimate, Photo]:
        estimate = estimate_blind(photo, EstimateOptions(), run=Run(1))
        return estimate, deblur(photo, estimate.content.kernel, run=Run(1)).photo

    (blind_estimate, result), cost = measured(fix)
    one, other = (encode(item.pixels, Srgb(), 8).astype(np.float32) for item in (photo, result))
    rms = float(np.sqrt(np.square(one - other).mean()) / 255)
    scores = (fit(photo, truth), fit(result, truth)) if change.disk else (0.0, 0.0)
    notes = [note for note in blind_estimate.notes if "50 mm" not in note]
    confidence = blind_estimate.content.confidence
    return Result(rms, *scores, confidence, cost.cpu, notes, result is photo)


def line(name: str, result: Result) -> str:
    """One case of the table."""
    passed = result.left or result.rms < MOST_RMS
    cells = [name, f"{100 * result.rms:.2f}"]
    if CASES[name].disk:
        passed = result.after > result.before - MOST_LOST
        cells += [f"{result.before:.1f}", f"{result.after - result.before:+.2f}"]
    else:
        cells += ["", ""]
    cells += [f"{result.confidence:.2f}", f"{result.seconds:.0f}", "yes" if passed else "NO"]
    return row([*cells, "; ".join(result.notes) or "-"])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of two more sharp photos")
    cases = partial(names, known=tuple(CASES))
    parser.add_argument("--cases", type=cases, help="names, separated by commas; default: all")


def run(args: argparse.Namespace) -> int:
    """Run the benchmark."""
    default = [name for name in CASES if args.data is not None or name not in AT_HAND]
    print(
        head(["photo", "rms, %", "blurred", "gain", "confidence", "s", "passed", "note"]),
        flush=True,
    )
    for name in args.cases or default:
        print(line(name, measure(CASES[name], args.data)), flush=True)
    return 0
