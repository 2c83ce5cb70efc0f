"""Run deshake on a photo, and write the pictures into a folder.

Without PHOTO, a known camera path shakes a real photo that a development dependency ships, and
`deshake fix` deblurs the shaken JPEG without further information. With PHOTO, that photo is fixed.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
from bench.cases.shipped import SHIPPED
from bench.metrics import motion_between, psnr
from PIL import Image, ImageDraw, ImageFont, ImageOps

from deshake import read_kernel, render_comparison, render_filters, render_kernel

PHOTO = "astronaut"
SEED = 3
BLUR_PX = 14
FILM_MM = 35
LEAST_GAIN_DB = 3.0
SHAKE = (
    "--blur-size", BLUR_PX, "--seed", SEED, "--noise", 0.003, "--photons", 20_000
)  # fmt: skip
BORDER = 24  # pixels left out of the comparison on every side
CROP = 160  # pixels a side of the 100 % crops, at least
GAP = 8
DESCRIPTION_TAG = 0x010E
FILM_TAG = 0xA405  # FocalLengthIn35mmFilm
EXIF_DIRECTORY = 0x8769


def deshake(*args: object) -> None:
    """Run the command line in a process of its own, and leave if it fails."""
    words = [str(arg) for arg in args]
    print("$ deshake", *words, flush=True)
    run = [sys.executable, "-m", "deshake", "--no-config", *words]
    done = subprocess.run(run, check=False)  # noqa: S603 - our own words
    if done.returncode:
        sys.exit(done.returncode)


def shipped_photo(name: str) -> Image.Image:
    """Return a photo that a development dependency ships."""
    return Image.fromarray(SHIPPED[name]())


def save_with_lens(photo: Image.Image, path: Path) -> None:
    """Save a photo with the EXIF tag of its lens, as a camera does."""
    exif = Image.Exif()
    exif[DESCRIPTION_TAG] = "from a development dependency of deshake"
    exif.get_ifd(EXIF_DIRECTORY)[FILM_TAG] = FILM_MM
    photo.save(path, exif=exif)


def display_values(path: Path) -> np.ndarray:
    """Read a photo as it is shown: (H, W, 3) float32, 0..1."""
    with Image.open(path) as image:
        upright = ImageOps.exif_transpose(image).convert("RGB")
    return np.asarray(upright, np.float32) / 255


def aligned_psnr(photo: np.ndarray, truth: np.ndarray) -> float:
    """Return the PSNR in dB of display values, borders left out.

    The truth is first shifted and turned as a whole, to fractions of a pixel, to where it fits
    the photo best: no blind method can know where the camera pointed on average.
    """
    still = np.eye(2, 3, dtype=np.float32)
    grey, sharp = (cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in (photo, truth))
    motion = motion_between(sharp, grey, still, iterations=200, precision=1e-7)
    if motion is None:  # nothing fits
        motion = still
    size = photo.shape[1::-1]
    way = cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP
    moved = cv2.warpAffine(truth, motion, size, flags=way, borderMode=cv2.BORDER_REPLICATE)
    inner = (slice(BORDER, -BORDER), slice(BORDER, -BORDER))
    return psnr(photo[inner].astype(np.float64), np.clip(moved, 0, 1)[inner])


def crop_side(picture: np.ndarray) -> int:
    """Return the side of the crops: an eighth of the width, within bounds."""
    return min(max(CROP, picture.shape[1] // 8), 480, *picture.shape[:2])


def busiest_crops(picture: np.ndarray, count: int) -> list[tuple[int, int]]:
    """Return the corners (x, y) of crops with much detail that do not overlap."""
    height, width = picture.shape[:2]
    side = crop_side(picture)
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    detail = np.abs(cv2.Laplacian(grey, cv2.CV_32F))
    corners = [
        (float(detail[y : y + side, x : x + side].mean()), x, y)
        for y in range(0, height - side + 1, max(side // 4, 1))
        for x in range(0, width - side + 1, max(side // 4, 1))
    ]
    chosen: list[tuple[int, int]] = []
    for _, x, y in sorted(corners, reverse=True):
        if all(abs(x - a) >= side or abs(y - b) >= side for a, b in chosen):
            chosen.append((x, y))
    return chosen[:count]


def contact_sheet(pictures: dict[str, np.ndarray], path: Path) -> None:
    """Save pictures side by side, each with its title above and 100 % crops below."""
    first = next(iter(pictures.values()))
    # The crops are chosen in the last picture, the sharpest, and are the same for all.
    crops = busiest_crops(list(pictures.values())[-1], 3)
    side = crop_side(first)
    across = len(crops) * side + (len(crops) - 1) * GAP
    down = round(first.shape[0] * across / first.shape[1])
    font = ImageFont.load_default(16)
    sheet = Image.new(
        "RGB", (len(pictures) * (across + 2 * GAP), down + side + 28 + 3 * GAP), "white"
    )
    draw = ImageDraw.Draw(sheet)
    for column, (title, picture) in enumerate(pictures.items()):
        left = column * (across + 2 * GAP) + GAP
        draw.text((left, GAP), title, "black", font)
        whole = Image.fromarray(np.rint(picture * 255).astype(np.uint8))
        sheet.paste(whole.resize((across, down), Image.Resampling.LANCZOS), (left, 28 + GAP))
        for number, (x, y) in enumerate(crops):
            crop = whole.crop((x, y, x + side, y + side))
            sheet.paste(crop, (left + number * (side + GAP), down + 28 + 2 * GAP))
    sheet.save(path)


def save(picture: np.ndarray, path: Path) -> None:
    """Save a rendered picture."""
    Image.fromarray(picture).save(path)


def shake_and_fix(out: Path) -> float:
    """Shake a sharp photo, fix it blindly, and return the gain in dB."""
    save_with_lens(shipped_photo(PHOTO), out / "original.png")
    shaken, fixed, sharp = out / "shaken.jpg", out / "deshaken.jpg", out / "sharp.png"
    deshake(
        "simulate", out / "original.png", "-o", shaken, "--kernel", out / "true.npz",
        "--sharp", sharp, *SHAKE, "--overwrite",
    )  # fmt: skip
    deshake("fix", shaken, "-o", fixed, "--keep-kernels", out, "--overwrite")
    truth = display_values(sharp)
    before, after = (aligned_psnr(display_values(path), truth) for path in (shaken, fixed))
    true, estimated = (read_kernel(out / name).kernel for name in ("true.npz", "shaken.kernel.npz"))
    save(render_comparison({"true": true, "estimated": estimated.centred()}), out / "kernels.png")
    save(render_filters(true, 4, 6), out / "filters-true.png")
    save(render_filters(estimated, 4, 6), out / "filters-estimated.png")
    contact_sheet(
        {
            f"shaken, {before:.2f} dB": display_values(shaken),
            f"deshaken, {after:.2f} dB": display_values(fixed),
            "the sharp photo": truth,
        },
        out / "before-after.png",
    )
    print(f"PSNR before {before:.2f} dB, after {after:.2f} dB: {after - before:+.2f} dB")
    print(f"(display values; the outer {BORDER} pixels left out; the truth shifted and turned as a")
    print("whole to where it fits each of the two best)")
    return after - before


def fix_own(photo: Path, out: Path) -> None:
    """Fix a photo of the user's own."""
    fixed = out / f"{photo.stem}.deshaken{photo.suffix}"
    deshake("fix", photo, "-o", fixed, "--keep-kernels", out, "--overwrite")
    kernel = read_kernel(out / f"{photo.stem}.kernel.npz").kernel
    save(render_kernel(kernel), out / "kernel.png")
    save(render_filters(kernel, 4, 6), out / "filters.png")
    pictures = {"before": display_values(photo), "after": display_values(fixed)}
    contact_sheet(pictures, out / "before-after.png")


def main() -> int:
    """Run the demo."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photo", nargs="?", type=Path, help="a shaken photo of your own")
    parser.add_argument("--output", type=Path, default=Path("out/demo"), help="folder")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    gain = None
    if args.photo is None:
        gain = shake_and_fix(args.output)
        made = "before-after.png", "kernels.png", "filters-true.png", "filters-estimated.png"
    else:
        fix_own(args.photo, args.output)
        made = "before-after.png", "kernel.png", "filters.png"
    print(
        f"{time.perf_counter() - start:.0f} s; look at", *(str(args.output / name) for name in made)
    )
    if gain is not None and gain < LEAST_GAIN_DB:
        print(f"error: a gain of {LEAST_GAIN_DB:g} dB was expected", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
