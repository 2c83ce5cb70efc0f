from __future__ import annotations

import logging
import os
import signal
import time
from multiprocessing import get_context

import pytest

from deshake.batch.task import Result
from deshake.batch.worker import LogLevels, LogMessage, ProgressMessage, serve

pytestmark = pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
LEVELS = LogLevels(logging.WARNING, logging.INFO)


@pytest.fixture
def process(trial):
    """Start a process, and give this end of its pipe."""
    context = get_context("forkserver" if os.name == "posix" else "spawn")
    pipe, other = context.Pipe()
    worker = context.Process(target=serve, args=(other, trial(), 1, LEVELS))
    worker.start()
    other.close()
    yield worker, pipe
    pipe.close()
    worker.kill()
    worker.join()


def test_every_job_sends_its_messages_back(process, jobs):
    worker, pipe = process
    for job in jobs("warn", "x"):
        pipe.send(job)
    messages = [pipe.recv() for _ in range(5 - 1)]
    kinds = [type(message) for message in messages]
    assert kinds[:3] == [LogMessage, ProgressMessage, Result]
    assert messages[0] == ("deshake.trial", logging.WARNING, f"{messages[2].job.source}: mind")
    pipe.close()
    worker.join(60)
    assert worker.exitcode == 0


def test_sigterm_ends_it_cleanly_and_sigint_does_not(process, jobs, await_sleepers, tmp_path):
    worker, pipe = process
    [job] = jobs("sleep 600")
    pipe.send(job)
    await_sleepers(0)
    os.kill(worker.pid, signal.SIGINT)
    time.sleep(0.1)
    assert worker.is_alive()
    os.kill(worker.pid, signal.SIGTERM)
    worker.join(60)
    assert worker.exitcode == 128 + signal.SIGTERM
    assert {path.name for path in tmp_path.iterdir()} == {"0.jpg", "0.out.begun"}
