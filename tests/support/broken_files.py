"""Run deshake on files that are broken on purpose, and list its faults.

Every photo passes calibrate and fix, every .npz file the command that reads it. A fault is a crash,
more than 10 seconds of the processor or 30 by the clock, more than 1 GB of memory, any exit code
but 0 and 1, an error that is not one line, or no error at exit code 1.

    python -m tests.support.broken_files --count 300 --seed 1
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import selectors
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .mutated_files import bombs, mutated, seeds

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

__all__ = ["Case", "Outcome", "cases", "run"]

_TESTS = Path(__file__).parents[1]
_SECONDS, _HANG, _BYTES = 10.0, 30.0, 1e9
_DONE = " -> "  # in the line that `fix` prints of a result
_ADDRESSES = 4 << 30  # what a child may map; what it may use is measured
_FIX = ("--blur-size", 3, "--estimator", "edges", "--uniform", "--quality", "fast")
_FIX = (*_FIX, "--iterations", 2, "--focal-35mm", 30, "-o", "{out}", "--overwrite")
_RUNS = {
    "kernel": [("deblur", "{a.png}", "{file}", "--iterations", 2, "-o", "{out}", "--overwrite")],
    "camera": [("estimate-blind", "{a.png}", "--camera", "{file}", "-o", "{npz}", "--overwrite")],
    "registration": [
        (
            *(
                "deblur",
                "{a.png}",
                "{kernel.npz}",
                "--noisy",
                "{noisy.png}",
                "--registration",
                "{file}",
            ),
            *("--iterations", 1, "-o", "{out}", "--overwrite"),
        )
    ],
    "photo": [("calibrate", "{file}"), ("fix", "{file}", *_FIX)],
}
"""Commands by the kind of the broken file; names in braces become paths."""


@dataclass(frozen=True)
class Case:
    """A run of deshake on a broken file."""

    name: str
    way: str
    words: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """The outcome: exit code (None: none), stderr, processor time, peak memory in bytes."""

    case: Case
    code: int | None
    err: str
    seconds: float
    memory: float

    def faults(self) -> list[str]:
        """Say what is wrong; nothing if the command did what it should."""
        faults = []
        if self.code is None:
            faults.append("crashed or did not end")
        elif self.code not in {0, 1}:
            faults.append(f"exit code {self.code}")
        if self.seconds > _SECONDS:
            faults.append(f"{self.seconds:.1f} s")
        if self.memory > _BYTES:
            faults.append(f"{self.memory / 1e9:.2f} GB")
        lines = self.err.splitlines()
        errors = sum(line.startswith("error: ") for line in lines)
        if self.code is not None and errors != self.code:
            faults.append(f"{errors} lines of errors at exit code {self.code}")
        known = ("error: ", "hint: ", "warning: ")
        if not all(line.startswith(known) or _DONE in line for line in lines):
            faults.append("lines that are neither errors, hints, warnings nor what was done")
        if "this is a bug" in self.err:
            faults.append("what is called a bug")
        return faults


def cases(folder: Path, count: int, seed: int, *, with_bombs: Iterable[str] = ()) -> Iterator[Case]:
    """Write as many broken files into a folder as asked for, and yield the runs on them."""
    sound = seeds(folder)
    for name, content in sound.items():
        (folder / name).write_bytes(content)
    (folder / "noisy.png").write_bytes(sound["a.png"])
    random = np.random.default_rng(seed)
    explosive = bombs(sound)
    files = [(name, "bomb") for name in with_bombs]
    files += [(name, "") for name in (list(sound) * count)[: count - len(files)]]
    for number, (name, known) in enumerate(files):
        way, content = (known, explosive[name]()) if known else mutated(sound[name], random)
        path = folder / f"{number:03}-{way}-{name}"
        path.write_bytes(content)
        kind = "kernel" if name == "bomb-array.npz" else Path(name).stem
        places = {file: str(folder / file) for file in (*sound, "noisy.png")}
        places |= {"file": str(path), "npz": str(folder / "out.npz")}
        suffix = ".tif" if path.suffix in {".dng", ".heic"} else path.suffix
        places["out"] = str(folder / ("out.png" if path.suffix == ".npz" else f"out{suffix}"))
        for words in _RUNS.get(kind, _RUNS["photo"]):
            filled = (places.get(str(word)[1:-1], str(word)) for word in words)
            yield Case(path.name, way, tuple(filled))


def run(todo: Sequence[Case]) -> Iterator[Outcome]:
    """Run cases one after the other, in a child that is replaced when it dies or hangs."""
    left = list(todo)
    while left:
        with _child() as child:
            while left and (outcome := _ask(child, left[0])) is not None:
                yield outcome
                left.pop(0)
            if left:
                child.kill()
                yield Outcome(left.pop(0), None, "", 0.0, 0.0)


def _child() -> subprocess.Popen[bytes]:
    """Start a child of one thread that may map so much and no more."""
    one = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONPATH": str(_TESTS)}
    return subprocess.Popen(
        [sys.executable, "-m", "support.broken_files", "--child"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | one,
        bufsize=0,  # so that nothing is left to be written to a child that died
    )


def _ask(child: subprocess.Popen[bytes], case: Case) -> Outcome | None:
    """Let a child run a case; None if it crashes, or takes far too long."""
    if child.stdin is None or child.stdout is None:
        return None
    with contextlib.suppress(BrokenPipeError):
        child.stdin.write(json.dumps(case.words).encode() + b"\n")
    with selectors.DefaultSelector() as selector:
        selector.register(child.stdout, selectors.EVENT_READ)
        answer = child.stdout.readline() if selector.select(_HANG) else b""
    return Outcome(case, **json.loads(answer)) if answer else None


def _serve() -> None:
    """Run what is asked for on stdin, and answer on what was stdout."""
    from deshake.cli.main import main  # noqa: PLC0415 - only the child needs it

    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
    answers = os.fdopen(os.dup(1), "w")
    with tempfile.TemporaryFile() as spoken:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(spoken.fileno(), 2)
        for line in sys.stdin:
            spoken.seek(0)
            spoken.truncate()
            _forget_peak()
            start = time.process_time()  # another program's load is no hang
            code = main(["--no-config", *json.loads(line), "--threads", "1"])
            seconds = time.process_time() - start
            sys.stderr.flush()
            spoken.seek(0)
            answer = {"code": code, "err": spoken.read().decode("utf-8", "replace")}
            answers.write(json.dumps(answer | {"seconds": seconds, "memory": _peak()}) + "\n")
            answers.flush()


def _forget_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5", "ascii")


def _peak() -> float:
    """Return the most memory that was resident since the last reset, in bytes."""
    status = Path("/proc/self/status").read_text("ascii")
    return 1024.0 * int(status.split("VmHWM:")[1].split()[0])


def main(args: Sequence[str] | None = None) -> int:
    """Run all, print the faults and a summary; 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300, help="how many files")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where the files go, to look at them")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args(args)
    if chosen.child:
        _serve()
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = chosen.folder or Path(scratch)
        folder.mkdir(exist_ok=True)
        names = bombs({})
        todo = list(cases(folder, chosen.count, chosen.seed, with_bombs=names))
        outcomes = list(run(todo))
    faulty = [outcome for outcome in outcomes if outcome.faults()]
    for outcome in faulty:
        print(f"{outcome.case.name}: {outcome.case.words[0]}: {'; '.join(outcome.faults())}")
        print(f"    {outcome.err.strip()[:400]}")
    refused = sum(outcome.code == 1 for outcome in outcomes)
    print(
        f"{chosen.count} files, {len(outcomes)} runs: {refused} refused, "
        f"{len(outcomes) - refused} not; {len(faulty)} with faults; at most "
        f"{max(outcome.seconds for outcome in outcomes):.1f} s and "
        f"{max(outcome.memory for outcome in outcomes) / 1e6:.0f} MB"
    )
    return 1 if faulty else 0


if __name__ == "__main__":
    sys.exit(main())
