"""Measure the stages of fix: seconds and peak memory, each in a process of its own.

    python scripts/benchmark_fix.py                     1, 3, 6 and 12 megapixels
    python scripts/benchmark_fix.py --megapixels 24
    python scripts/benchmark_fix.py photo.jpg ...       photos of your own

Without photos, a real one that a development dependency ships is enlarged, shaken by 0.8 % of its
width, and saved as a JPEG.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from skimage import data

MEGAPIXELS = [1.0, 3.0, 6.0, 12.0]
SHAKE = 0.008  # of the width
FILM_MM = 35
KIB = 1024 if sys.platform == "darwin" else 1  # ru_maxrss is in bytes there, else in KiB


class Run(NamedTuple):
    """The cost of a run."""

    seconds: float
    cpu: float
    peak_mb: float


def deshake(*args: object) -> Run:
    """Run the command line in a process of its own, and measure it; leave if it fails."""
    words = [sys.executable, "-m", "deshake", "--no-config", *map(str, args)]
    words += ["--overwrite", "-q"]
    start = time.perf_counter()
    process = subprocess.Popen(words)  # noqa: S603 - our own words
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(process.returncode)
    return Run(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / KIB / 1024)


def shaken_photo(megapixels: float, folder: Path) -> Path:
    """Make a shaken JPEG of 3:2 with so many pixels."""
    height = round((megapixels * 1e6 / 1.5) ** 0.5)
    width = round(1.5 * height)
    photo = Image.fromarray(data.coffee()).resize((width, height), Image.Resampling.BICUBIC)
    codes = np.asarray(photo, np.int16)
    grain = np.random.default_rng(0).normal(0, 6, (height, width, 1)).astype(np.int16)
    sharp, shaken = folder / "sharp.png", folder / f"{megapixels:g}-megapixels.jpg"
    Image.fromarray(np.clip(codes + grain, 0, 255).astype(np.uint8)).save(sharp, compress_level=1)
    lens = ("--focal-35mm", FILM_MM, "--keep-size", "--photons", 20_000)
    deshake("simulate", sharp, "-o", shaken, "--blur-size", SHAKE * width, *lens)
    return shaken


def measure(photo: Path, folder: Path, threads: int | None) -> None:
    """Print the cost of each stage on a photo, and of fix as one command."""
    kernel, sharp = folder / "kernel.npz", folder / f"out{photo.suffix}"
    more = () if threads is None else ("--threads", threads)
    lens = ("--focal-35mm", FILM_MM) if folder in photo.parents else ()
    with Image.open(photo) as image:
        name = f"{photo.name}, {image.width} x {image.height}"
    for stage, args in {
        "estimate-blind": (photo, "-o", kernel, *lens),
        "deblur": (photo, kernel, "-o", sharp),
        "fix": (photo, "-o", sharp, *lens),
    }.items():
        run = deshake(stage, *args, *more)
        print(
            f"{name:<40} {stage:<15} {run.seconds:8.1f} {run.cpu:8.1f} {run.peak_mb:9.0f}",
            flush=True,
        )


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photos", nargs="*", type=Path)
    parser.add_argument("--megapixels", type=float, nargs="+", metavar="M")
    parser.add_argument("--threads", type=int, metavar="N")
    args = parser.parse_args()
    sizes = args.megapixels or ([] if args.photos else MEGAPIXELS)
    print(f"{'photo':<40} {'stage':<15} {'seconds':>8} {'CPU s':>8} {'peak, MB':>9}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for photo in args.photos:
            measure(photo, folder, args.threads)
        for size in sizes:
            measure(shaken_photo(size, folder), folder, args.threads)
    return 0


if __name__ == "__main__":
    sys.exit(main())
