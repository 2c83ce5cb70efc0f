"""Folders of photos: killed and resumed, photos per hour, and memory.

    python scripts/bench.py folders kills       40 small photos, killed ten times and resumed
    python scripts/bench.py folders rate        -j 2 against -j 1, with one thread and with two
    python scripts/bench.py folders memory      24-megapixel photos, within --memory 8G
    python scripts/bench.py folders rate --photos 4 --megapixels 0.3 --options="--quality fast"

`--options` go to `deshake fix`. The kills are in turn by SIGINT, SIGTERM and SIGKILL,
after times drawn from a seed; in the end there must be the results of a run that nobody disturbed,
to the byte, and nothing else. The rate is measured on as many processors as --processors says.
Memory is that of all processes together, shared pages counted once, sampled ten times a second.
"""

from __future__ import annotations

import json
import os
import random
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
import psutil
from skimage import data

from bench.arguments import at_least
from bench.commands import command, shaken_jpeg

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

QUICK = ["--blur-size", "3", "--uniform", "--estimator", "edges", "--focal-35mm", "40"]
ENDINGS = ["jpg", "png", "tif", "webp", "JPG", "tiff"]
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGKILL]
INTERVAL = 0.1


class Outcome(NamedTuple):
    """How a run ended, what it printed for each photo, and its seconds."""

    code: int
    lines: list[dict[str, object]]
    seconds: float


def fix(*words: object) -> Outcome:
    """Run fix to its end."""
    start = time.perf_counter()
    done = subprocess.run(  # noqa: S603 - our own words
        command("fix", *words, "--json", "-q"),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        check=False,
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    return Outcome(done.returncode, lines, time.perf_counter() - start)


def write_photos(folder: Path, count: int, broken: int) -> None:
    """Write small photos of many kinds in two folders, the last `broken` of them damaged."""
    (folder / "below").mkdir(parents=True)
    scene = cv2.filter2D(data.astronaut(), -1, np.eye(5, dtype=np.float32) / 5)
    rng = np.random.default_rng(0)
    for number in range(count):
        height, width = rng.integers(60, 140, 2)
        y, x = rng.integers(0, 360, 2)
        codes = scene[y : y + height, x : x + width]
        if number % 5 == 4:
            codes = codes[..., 1]  # grey
        ending = ENDINGS[number % len(ENDINGS)]
        if ending in {"png", "tif"} and number % 2:
            codes = codes.astype(np.uint16) * 257
        place = folder / "below" if number % 3 == 2 else folder
        path = place / f"IMG_{number}.{ending}"
        content = cv2.imencode(path.suffix.lower(), codes)[1].tobytes()
        left = number - (count - broken)
        if left >= 0:  # empty, no photo at all, cut short, damaged
            content = [b"", b"no photo", content[: len(content) // 2], content[:30] * 9][left % 4]
        path.write_bytes(content)


def contents(folder: Path) -> dict[str, bytes]:
    """Read all files below a folder."""
    files = {}
    for path in folder.rglob("*"):
        with suppress(FileNotFoundError):  # a part file that has taken its name meanwhile
            if path.is_file():
                files[str(path.relative_to(folder))] = path.read_bytes()
    return files


def await_more(folder: Path, process: subprocess.Popen[bytes]) -> None:
    """Wait until a run has begun to write, or has ended."""
    before = len(contents(folder))
    while process.poll() is None and len(contents(folder)) <= before:
        time.sleep(0.01)


def kills(
    folder: Path, photos: int, broken: int, times: int, words: Sequence[str], *, spread: float = 0.5
) -> bool:
    """Kill a run again and again, resume it, and compare with one that nobody disturbed.

    Most kills come after a result was begun, at a random time within `spread` / (`times` + 1) of
    the time of a run.
    """
    source, alone, killed = (folder / name for name in ("in", "alone", "killed"))
    write_photos(source, photos, broken)
    common = (source, "-r", "-j", 2, "--threads", 1, *words)
    whole = fix(*common, "-o", alone)
    failed = [line for line in whole.lines if line["status"] == "failed"]
    made = contents(alone)
    print(f"alone: exit {whole.code}, {len(made)} results, {len(failed)} errors")
    for line in failed:
        print(f"    {Path(str(line['error'])).name}")
    rng = random.Random(0)  # noqa: S311 - moments, not secrets
    for number in range(times):
        process = subprocess.Popen(  # noqa: S603 - our own words
            command("fix", *common, "-o", killed, "--skip-existing", "-q"),
            stderr=subprocess.DEVNULL,
        )
        if number % 4 != 3:  # else perhaps before it is under way
            await_more(killed, process)
        time.sleep(rng.uniform(0, spread / (times + 1)) * whole.seconds)
        process.send_signal(SIGNALS[number % 3])
        code = process.wait()
        left = contents(killed)
        parts = [name for name in left if name.endswith(".part")]
        results = len(left) - len(parts)
        print(f"{SIGNALS[number % 3].name}: exit {code}, {results} results, {len(parts)} parts")
    last = fix(*common, "-o", killed, "--skip-existing")
    counts = [
        sum(line["status"] == s for line in last.lines) for s in ("done", "skipped", "failed")
    ]
    same = contents(killed) == made
    print(f"resumed: exit {last.code}, done, skipped, failed: {counts}; the same bytes: {same}")
    right = (whole.code, last.code, len(made), len(failed)) == (1, 1, photos - broken, broken)
    return same and right


def write_copies(folder: Path, photos: int, megapixels: float) -> Path:
    """Write a shaken photo several times into a folder of its own."""
    source = folder / "in"
    source.mkdir()
    photo = shaken_jpeg(megapixels, folder)
    for number in range(photos):
        shutil.copy(photo, source / f"{number}.jpg")
    return source


def rate(folder: Path, photos: int, megapixels: float, words: Sequence[str]) -> bool:
    """Print photos per hour for jobs and threads."""
    source = write_copies(folder, photos, megapixels)
    base = None
    for jobs, threads in ((1, 1), (2, 1), (1, 2)):
        out = folder / f"{jobs}-{threads}"
        done = fix(source, "-o", out, "-j", jobs, "--threads", threads, *words)
        if done.code:
            return False
        hourly = 3600 * photos / done.seconds
        base = base or hourly
        print(f"-j {jobs} --threads {threads}: {hourly:7.1f} photos an hour, {hourly / base:.2f}")
    return True


def tree_memory(process: psutil.Process) -> int:
    """Bytes that a process and all below it hold, shared pages counted once."""
    total = 0
    for each in [process, *process.children(recursive=True)]:
        with suppress(psutil.Error):
            total += each.memory_full_info().pss
    return total


def memory(
    folder: Path, photos: int, megapixels: float, limit: float, words: Sequence[str]
) -> bool:
    """Print the most memory that a run over large photos held, and how many were under way."""
    source = write_copies(folder, photos, megapixels)
    fixed = command("fix", source, "-o", folder / "out", "-j", photos, "--threads", 1, "-q", *words)
    start, peak = time.perf_counter(), 0
    process = psutil.Popen([*fixed, "--memory", f"{limit}G"])
    while process.poll() is None:
        with suppress(psutil.Error):
            peak = max(peak, tree_memory(process))
        time.sleep(INTERVAL)
    took = time.perf_counter() - start
    print(f"{photos} photos of {megapixels:g} megapixels, --memory {limit:g}G: exit", end=" ")
    print(f"{process.returncode}, at most {peak / 1e9:.2f} GB, {took:.0f} s")
    return process.returncode == 0 and peak <= limit * 1e9


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("what", choices=["kills", "rate", "memory"])
    parser.add_argument("--photos", type=partial(at_least, 1), metavar="N")
    parser.add_argument("--broken", type=partial(at_least, 0), default=5, metavar="N")
    parser.add_argument("--kills", type=partial(at_least, 0), default=10, metavar="N")
    parser.add_argument("--megapixels", type=float, metavar="M")
    parser.add_argument("--memory", type=float, default=8, metavar="GB")
    parser.add_argument("--processors", type=partial(at_least, 1), default=2, metavar="N")
    parser.add_argument("--options", type=shlex.split, default=[], help="of deshake fix")


def run(args: argparse.Namespace) -> int:
    """Run one of the benchmarks."""
    words = args.options
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if args.what == "kills":
            right = kills(folder, args.photos or 40, args.broken, args.kills, words or QUICK)
        elif args.what == "rate":
            if hasattr(os, "sched_setaffinity"):
                os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: args.processors])
            right = rate(folder, args.photos or 8, args.megapixels or 1, words)
        else:
            megapixels, photos = args.megapixels or 24, args.photos or 4
            right = memory(folder, photos, megapixels, args.memory, words)
    return 0 if right else 1
