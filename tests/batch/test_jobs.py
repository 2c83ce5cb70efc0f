from __future__ import annotations

import os

import pytest

from deshake.batch.jobs import Resources, run_jobs
from deshake.run import Run


@pytest.mark.parametrize("processors", [1, 2, 8])
def test_processors_are_shared_out(monkeypatch, processors):
    monkeypatch.setattr("deshake.batch.jobs.available_threads", lambda: processors)
    assert Resources().shared(1, None) == (1, processors)
    assert Resources().shared(1000, None) == (processors, 1)
    assert Resources(photos_at_once=2).shared(1000, None) == (2, max(1, processors // 2))
    assert Resources().shared(1000, processors) == (1, processors)
    assert Resources(photos_at_once=3).shared(1000, 5) == (3, 5)
    assert Resources(photos_at_once=3).shared(2, None)[0] == 2


def test_one_photo_is_worked_on_here(trial, jobs):
    reports = []
    [result] = run_jobs(
        jobs("x"), trial(), Resources(), Run(progress=lambda *word: reports.append(word))
    )
    assert result.figures["pid"] == os.getpid()
    assert reports == [(0.5, "half")]


def test_several_photos_run_elsewhere_and_their_progress_adds_up(trial, jobs):
    made = jobs("x", "x", "skipped", "x", existing="skip")
    made[2].output.touch()
    reports = []
    resources = Resources(photos_at_once=1)
    results = list(run_jobs(made, trial(), resources, Run(1, lambda *word: reports.append(word))))
    assert [result.status for result in results] == ["done", "done", "skipped", "done"]
    assert os.getpid() not in {result.figures.get("pid") for result in results}
    shares = [share for share, _ in reports]
    assert shares == sorted(shares)
    assert shares[0] == pytest.approx(1 / 6)
    assert reports[-1] == (pytest.approx(1), "3 of 3 photos")
