"""Runs of deshake's command line in processes of their own, and shaken JPEGs for them."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image
from skimage import data

from bench.processes import RUSAGE_UNIT, Cost

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["FILM_MM", "command", "deshake", "shaken_jpeg"]

SHAKE = 0.008  # of the width
FILM_MM = 35


def command(*words: object) -> list[str]:
    """Return the words that run deshake."""
    return [sys.executable, "-m", "deshake", "--no-config", *map(str, words)]


def deshake(*words: object) -> Cost:
    """Run the command line and measure it; leave if it fails."""
    start = time.perf_counter()
    process = subprocess.Popen(command(*words, "--overwrite", "-q"))  # noqa: S603 - our own words
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(process.returncode)
    peak = usage.ru_maxrss * RUSAGE_UNIT / 1e9
    return Cost(seconds, usage.ru_utime + usage.ru_stime, peak)


def shaken_jpeg(megapixels: float, folder: Path) -> Path:
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
