"""Fix photos that were not shaken, or are out of focus: they must not be made worse.

    python scripts/benchmark_sharp.py
    python scripts/benchmark_sharp.py --cases "coffee,coffee jpeg 75" --data DIR

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

import argparse
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from arguments import names
from numpy.typing import NDArray
from PIL import Image as Pictures
from shaken_photos import aligned, display, psnr
from skimage import data
from sklearn.datasets import load_sample_image

from deshake.errors import DeshakeError
from deshake.formats.photo import Photo, read_photo
from deshake.formats.transfer import Srgb, decode, encode
from deshake.run import Run
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.deblurring import deblur
from deshake.stages.estimate_options import EstimateOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Codes = NDArray[np.uint8]
Image = NDArray[np.float32]

PHOTOS: dict[str, Callable[[], Codes]] = {
    "astronaut": data.astronaut,
    "brick": data.brick,
    "camera": data.camera,
    "chelsea": data.chelsea,
    "china": partial(load_sample_image, "china.jpg"),
    "coffee": data.coffee,
    "coins": data.coins,
    "flower": partial(load_sample_image, "flower.jpg"),
    "grass": data.grass,
    "hubble": data.hubble_deep_field,
    "ihc": data.immunohistochemistry,
    "moon": data.moon,
    "motorcycle": lambda: data.stereo_motorcycle()[0],
    "page": data.page,
    "rocket": data.rocket,
    "text": data.text,
}
FOUND = {"houses": "houses.jpg", "manmade": "manmade_01.png"}  # in the folder of data
LONGEST = 1024  # px: longer side; larger photos of that folder are reduced to it
MOST_RMS = 0.005  # of full scale
MOST_LOST = 0.1  # dB
BORDER = 12  # px left out of the comparison on every side


class Case(NamedTuple):
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
    **{name: Case(name) for name in PHOTOS},
    **{f"{name} jpeg 75": Case(name, 75) for name in ("astronaut", "coffee", "camera", "page")},
    **{f"{name} jpeg 85": Case(name, 85) for name in ("china", "motorcycle", "chelsea")},
    **{f"{name} jpeg 95": Case(name, 95) for name in ("astronaut", "flower")},
    **{f"{name} noise": Case(name, 92, 0.01) for name in ("astronaut", "coffee", "rocket")},
    **{f"{name} strong noise": Case(name, 92, 0.03) for name in ("astronaut", "china")},
    "astronaut part": Case("astronaut", part=(0, 0.55, 0.2, 0.75)),
    "china roofs": Case("china", part=(0.3, 0.9, 0.3, 0.9)),
    "coffee part": Case("coffee", 90, part=(0.2, 0.9, 0.1, 0.6)),
    "motorcycle part": Case("motorcycle", part=(0.3, 1, 0.1, 0.6)),
    "china sky": Case("china", 90, part=(0, 0.55, 0, 1)),
    "rocket sky": Case("rocket", 90, part=(0, 0.6, 0, 1)),
    "china night": Case("china", 92, 0.01, light=0.1),
    "motorcycle night": Case("motorcycle", 92, 0.005, light=0.1),
    "astronaut overexposed": Case("astronaut", 92, 0.005, light=2.5),
}
AT_HAND = {name: Case(name) for name in FOUND}
UNFOCUSED = {
    f"{name} disk {disk:g}": Case(name, quality, sigma, disk=disk)
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


def disk(across: float) -> Image:
    """Draw a disk so many pixels across, anti-aliased; its sum is 1."""
    fine, side = 8, 2 * int(np.ceil(across / 2)) + 1
    place = (np.arange(side * fine) + 0.5) / fine - side / 2
    inside = place[:, None] ** 2 + place**2 <= across**2 / 4
    filled = inside.reshape(side, fine, side, fine).mean((1, 3))
    return (filled / filled.sum()).astype(np.float32)


def read(name: str, folder: Path | None) -> Codes:
    """Read a photo; raise DeshakeError where it is not in the folder."""
    if name in PHOTOS:
        return np.ascontiguousarray(PHOTOS[name]())
    places = [] if folder is None else sorted(folder.rglob(FOUND[name]))
    if not places:
        raise DeshakeError(f"no {FOUND[name]}", hint="name its folder with --data")
    picture = Pictures.open(places[0]).convert("RGB")
    picture.thumbnail((LONGEST, LONGEST), Pictures.Resampling.BOX)
    return np.asarray(picture)


def prepare(case: Case, folder: Path | None, path: Path) -> tuple[Path, Image]:
    """Write the photo of a case under a name without an ending; return it and the truth."""
    codes = read(case.photo, folder)
    height, width = codes.shape[:2]
    top, bottom, left, right = case.part
    codes = codes[
        round(top * height) : round(bottom * height), round(left * width) : round(right * width)
    ]
    if case.sigma == case.disk == 0 and case.light == 1:
        stored = codes  # to the code
    else:
        light = decode(codes, Srgb()) * np.float32(case.light)
        if case.disk:
            light = cv2.filter2D(light, -1, disk(case.disk), borderType=cv2.BORDER_REFLECT)
        grain = np.random.default_rng(len(case.photo)).standard_normal(light.shape)
        shown = Srgb().from_linear(np.clip(light, 0, 1)) + case.sigma * grain
        stored = np.rint(255 * np.clip(shown, 0, 1)).astype(np.uint8)
    path = path.with_suffix(".png" if case.quality is None else ".jpg")
    options = {} if case.quality is None else {"quality": case.quality}
    Pictures.fromarray(stored).save(path, **options)
    return path, decode(codes, Srgb())


def fit(photo: Photo, truth: Image) -> float:
    """PSNR of display values at the shift and turn that fit best."""
    image, sharp = display(photo.pixels), display(truth)
    if image.ndim == 2:
        image, sharp = (np.repeat(one[..., None], 3, 2) for one in (image, sharp))
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    return max(psnr(one[inner], sharp[inner]) for one in (image, aligned(image, sharp)))


def measure(case: Case, folder: Path | None) -> Result:
    """Fix the photo of a case by default."""
    with tempfile.TemporaryDirectory() as scratch:
        path, truth = prepare(case, folder, Path(scratch) / "photo")
        photo = read_photo(path)
        start = time.process_time()
        blind_estimate = estimate_blind(photo, EstimateOptions(), run=Run(1))
        result = deblur(photo, blind_estimate.content.kernel, run=Run(1))
    seconds = time.process_time() - start
    one, other = (encode(item.pixels, Srgb(), 8).astype(np.float32) for item in (photo, result))
    rms = float(np.sqrt(np.square(one - other).mean()) / 255)
    scores = (fit(photo, truth), fit(result, truth)) if case.disk else (0.0, 0.0)
    notes = [note for note in blind_estimate.notes if "50 mm" not in note]
    confidence = blind_estimate.content.confidence
    return Result(rms, *scores, confidence, seconds, notes, result is photo)


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
    return "| " + " | ".join([*cells, "; ".join(result.notes) or "-"]) + " |"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help="folder of two more sharp photos")
    cases = partial(names, known=tuple(CASES))
    parser.add_argument("--cases", type=cases, help="names, separated by commas; default: all")
    args = parser.parse_args(argv)
    default = [name for name in CASES if args.data is not None or name not in AT_HAND]
    print("| photo | rms, % | blurred | gain | confidence | s | passed | note |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for name in args.cases or default:
        try:
            print(line(name, measure(CASES[name], args.data)), flush=True)
        except DeshakeError as error:
            print(f"error: {error}\nhint: {error.hint}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
