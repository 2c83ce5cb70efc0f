from __future__ import annotations

import logging
import os
import signal
import time
from multiprocessing import get_context

import pytest

from deshake.batch.task import Result
from deshake.batch.worker import LogLevels, Said, Shown, serve

pytestmark = pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
LEVELS = LogLevels(logging.WARNING, logging.INFO)


@pytest.fixture
def process(trial):
    """Start a process, and give this end of its line."""
    context = get_context("forkserver" if os.name == "posix" else "spawn")
    line, other = context.Pipe()
    worker = context.Process(target=serve, args=(other, trial(), 1, LEVELS))
    worker.start()
    other.close()
    yield worker, line
    line.close()
    worker.kill()
    worker.join()


def test_word_comes_back_for_every_job(process, jobs):
    worker, line = process
    for job in jobs("warn", "x"):
        line.send(job)
    heard = [line.recv() for _ in range(5 - 1)]
    kinds = [type(message) for message in heard]
    assert kinds[:3] == [Said, Shown, Result]
    assert heard[0] == ("deshake.trial", logging.WARNING, f"{heard[2].job.source}: mind")
    line.close()
    worker.join(60)
    assert worker.exitcode == 0


def test_it_leaves_cleanly_on_sigterm_and_not_on_sigint(process, jobs, await_sleepers, tmp_path):
    worker, line = process
    [job] = jobs("sleep 600")
    line.send(job)
    await_sleepers(0)
    os.kill(worker.pid, signal.SIGINT)
    time.sleep(0.1)
    assert worker.is_alive()
    os.kill(worker.pid, signal.SIGTERM)
    worker.join(60)
    assert worker.exitcode == 128 + signal.SIGTERM
    assert {path.name for path in tmp_path.iterdir()} == {"0.jpg", "0.out.begun"}
