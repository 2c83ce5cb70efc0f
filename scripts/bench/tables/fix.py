"""Measure the commands of one photo: seconds and peak memory, each in a process of its own.

    python scripts/bench.py fix                     1, 3, 6 and 12 megapixels
    python scripts/bench.py fix --megapixels 24
    python scripts/bench.py fix photo.jpg ...       photos of your own

Without photos, a real one that a development dependency ships is enlarged, shaken by 0.8 % of its
width, and saved as a JPEG.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from bench.arguments import add_threads
from bench.commands import FILM_MM, deshake, shaken_jpeg
from bench.markdown import head, row

if TYPE_CHECKING:
    import argparse

MEGAPIXELS = [1.0, 3.0, 6.0, 12.0]


def measure(photo: Path, folder: Path, threads: int | None) -> None:
    """Print the cost of each stage on a photo, and of fix as one command."""
    kernel, sharp = folder / "kernel.npz", folder / f"out{photo.suffix}"
    more = () if threads is None else ("--threads", threads)
    lens = ("--focal-35mm", FILM_MM) if folder in photo.parents else ()
    with Image.open(photo) as image:
        size = f"{image.width} x {image.height}"
    for stage, words in {
        "estimate-blind": (photo, "-o", kernel, *lens),
        "deblur": (photo, kernel, "-o", sharp),
        "fix": (photo, "-o", sharp, *lens),
    }.items():
        cost = deshake(stage, *words, *more)
        cells = [f"{cost.seconds:.1f}", f"{cost.cpu:.1f}", f"{cost.peak_gb:.2f}"]
        print(row([photo.name, size, stage, *cells]), flush=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("photos", nargs="*", type=Path, metavar="PHOTO")
    parser.add_argument("--megapixels", type=float, nargs="+", metavar="M")
    add_threads(parser, None)


def run(args: argparse.Namespace) -> int:
    """Measure, and print the table."""
    sizes = args.megapixels or ([] if args.photos else MEGAPIXELS)
    print(head(["photo", "size", "command", "wall s", "CPU s", "peak GB"]), flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for photo in args.photos:
            measure(photo, folder, args.threads)
        for size in sizes:
            measure(shaken_jpeg(size, folder), folder, args.threads)
    return 0
