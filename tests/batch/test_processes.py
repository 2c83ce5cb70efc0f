from __future__ import annotations

import logging
import os
import signal
import time

import pytest

from deshake.batch.memory import Budget
from deshake.batch.processes import run_in_processes

ROOM = Budget(10**9)


@pytest.fixture
def run(trial):
    def start(jobs, *, processes=2, budget=ROOM, progress=lambda *_: None, need=1):
        return run_in_processes(
            jobs, trial(need), processes=processes, threads=1, budget=budget, progress=progress
        )

    return start


def test_every_photo_is_worked_on_elsewhere_and_once(run, jobs, caplog):
    reports = []
    made = jobs("fail", "warn", "x", "bug", "x")
    results = dict(run(made, progress=lambda *word: reports.append(word)))
    status = [results[number].status for number in range(5)]
    assert status == ["failed", "done", "done", "failed", "done"]
    assert [results[number].job.source for number in range(5)] == [job.source for job in made]
    pids = {result.figures["pid"] for result in results.values() if result.figures}
    assert os.getpid() not in pids
    assert len(pids) <= 2
    assert (2, 0.5, "half") in reports
    assert f"{made[1].source}: mind" in caplog.messages


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
def test_a_killed_process_takes_down_one_photo(run, jobs, tmp_path):
    made = jobs("x", "kill SIGKILL", "x", "kill SIGSEGV", "x", "x")
    results = dict(run(made))
    status = [results[number].status for number in range(6)]
    assert status == ["done", "failed", "done", "failed", "done", "done"]
    assert f"{made[1].source}: its process was killed" in results[1].error
    assert "-j 1" in results[1].hint
    assert "SIGSEGV" in results[3].error
    outputs = sorted(job.output for n, job in enumerate(made) if n not in {1, 3})
    assert sorted(set(tmp_path.iterdir()) - {job.source for job in made}) == outputs


def test_photos_wait_for_memory(run, jobs, tmp_path):
    made = jobs("sleep .2", "x", "sleep .2", "sleep .2")
    # Eight pixels a byte: 640 of need where there is a sleep, of which one fits, and 80 where not.
    results = dict(run(made, processes=3, budget=Budget(1200), need=10))
    assert {result.status for result in results.values()} == {"done"}
    begun = [(tmp_path / f"{n}.out.begun").stat().st_mtime_ns for n in (0, 2, 3)]
    ended = [(tmp_path / f"{n}.out").stat().st_mtime_ns for n in (0, 2, 3)]
    assert ended[0] <= begun[1]
    assert ended[1] <= begun[2]


def test_a_photo_that_needs_more_goes_alone_or_is_refused(run, jobs, caplog):
    results = dict(run(jobs("x", "x"), budget=Budget(5), need=2_000_000_000))
    assert [results[n].status for n in (0, 1)] == ["done", "done"]
    assert "GB of memory, and only 0 MB are free: it is worked on alone" in caplog.text
    made = jobs("x", existing="replace")
    [(_, result)] = run(made, budget=Budget(7, given=True), need=10)
    assert result.status == "failed"
    assert "more than --memory" in result.error


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
def test_closing_ends_what_is_under_way_and_leaves_nothing(run, jobs, await_sleepers, tmp_path):
    made = jobs("x", "sleep 600", "sleep 600")
    running = run(made, processes=3)
    next(running)
    await_sleepers(1, 2)
    start = time.monotonic()
    running.close()
    assert time.monotonic() - start < 60
    left = {path.name for path in tmp_path.iterdir() if path.suffix != ".begun"}
    assert left == {"0.jpg", "1.jpg", "2.jpg", "0.out"}


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
def test_an_interrupt_from_the_keyboard_is_not_for_the_processes(run, jobs):
    results = dict(run(jobs("kill SIGINT", "x"), processes=1))
    assert [results[n].status for n in (0, 1)] == ["done", "done"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_log_keeps_its_levels(run, jobs, caplog):
    caplog.set_level(logging.ERROR, "deshake")
    assert dict(run(jobs("warn", "x")))[0].status == "done"
    assert caplog.messages == []
