"""Work of the tests' own, which other processes can load."""

from __future__ import annotations

import time
from importlib import import_module
from typing import TYPE_CHECKING

import pytest

from deshake.batch.plan import Job

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

# The content of a photo says what the work does with it.
WORK = """
import logging, os, signal, time
from pathlib import Path
from deshake.errors import PhotoError
from deshake.files.disk import atomic_write

class Trial:
    def __init__(self, need=1):
        self.need = need

    def __call__(self, job, run):
        word, _, rest = job.source.read_text().partition(" ")
        if word == "fail":
            raise PhotoError("is bad", hint="drop it", file=job.source)
        if word == "bug":
            raise ZeroDivisionError("by zero")
        with atomic_write(job.output, overwrite=job.overwrite) as stream:
            if word == "kill":
                os.kill(os.getpid(), getattr(signal, rest))
            if word == "sleep":
                Path(str(job.output) + ".begun").touch()
                time.sleep(float(rest))
            stream.write(b"done")
        if word == "warn":
            logging.getLogger("deshake.trial").warning("%s: mind", job.source)
        run.report(0.5, "half")
        return {"pid": os.getpid(), "threads": run.threads}

    def memory(self, job, size, threads):
        return self.need * max(size.pixels, 1)

    def origin(self, job):
        return {}
"""


@pytest.fixture
def trial(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., object]:
    """Make work, in a module on the path, that does what the photos say."""
    folder = tmp_path_factory.mktemp("work")
    name = f"trial_{folder.name}"
    (folder / f"{name}.py").write_text(WORK)
    monkeypatch.syspath_prepend(folder)
    return import_module(name).Trial


@pytest.fixture
def jobs(tmp_path: Path) -> Callable[..., list[Job]]:
    """Write photos that say what is to be done with them, and plan their results."""

    def make(*words: str, existing: str = "refuse") -> list[Job]:
        made = []
        for number, word in enumerate(words):
            source = tmp_path / f"{number}.jpg"
            source.write_text(word)
            made.append(Job(source, tmp_path / f"{number}.out", existing=existing))
        return made

    return make


@pytest.fixture
def await_sleepers(tmp_path: Path) -> Callable[..., None]:
    """Wait until the jobs of some numbers sleep."""

    def wait(*numbers: int) -> None:
        deadline = time.monotonic() + 60
        while not all((tmp_path / f"{number}.out.begun").exists() for number in numbers):
            assert time.monotonic() < deadline
            time.sleep(0.02)

    return wait
