from __future__ import annotations

import os

import pytest

from deshake.run import Run, available_threads


class Listener:
    """A receiver of progress that keeps all reports."""

    def __init__(self) -> None:
        self.shares: list[float] = []
        self.texts: list[str] = []

    def __call__(self, share: float, text: str) -> None:
        self.shares.append(share)
        self.texts.append(text)


@pytest.fixture
def listener() -> Listener:
    return Listener()


def test_all_processors_work_unless_the_threads_are_given(monkeypatch) -> None:
    monkeypatch.setattr("deshake.run.available_threads", lambda: 7)
    assert Run().workers == 7
    assert Run(3).workers == 3


def test_the_processors_are_those_that_this_process_may_use(monkeypatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 5)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 2, 3}, raising=False)
    assert available_threads() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    assert available_threads() == 5
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert available_threads() == 1


def test_a_report_reaches_the_listener(listener) -> None:
    Run(1, listener).report(0.25, "half of a half")
    assert (listener.shares, listener.texts) == ([0.25], ["half of a half"])


def test_a_part_reports_its_share_of_the_whole(listener) -> None:
    step = Run(3, listener).part(0.25, 0.75)
    for share, text in ((0.0, "begun"), (0.5, "half"), (1.0, "done")):
        step.report(share, text)
    assert listener.texts == ["begun", "half", "done"]
    assert listener.shares == [0.25, 0.5, 0.75]
    assert step.threads == 3


def test_parts_of_parts_report_to_the_whole(listener) -> None:
    Run(1, listener).part(0.5, 1).part(0, 0.5).report(1.0, "")
    assert listener.shares == [0.75]


def test_parts_follow_each_other_and_end_at_one(listener) -> None:
    efforts = (8, 0, 3, 0.1, 0.7)
    for step in Run(1, listener).parts(efforts):
        for share in (0.0, 1 / 3, 0.999999999999, 1.0):
            step.report(share, "")
    assert listener.shares == sorted(listener.shares)
    assert (listener.shares[0], listener.shares[-1]) == (0, 1)
    assert listener.shares[3] == pytest.approx(8 / sum(efforts))


def test_a_rising_run_never_falls(listener) -> None:
    run = Run(1, listener).rising()
    for share in (0.0, 0.5, 0.2, 0.6):
        run.report(share, "")
    assert listener.shares == [0.0, 0.5, 0.5, 0.6]


def test_a_silent_run_keeps_its_threads_only(listener) -> None:
    run = Run(2, listener).silent()
    run.report(1.0, "done")
    assert run == Run(2)
    assert listener.shares == []


def test_nobody_need_listen() -> None:
    run = Run(2)
    for one in (run, run.part(0, 0.5), run.rising(), *run.parts((1, 2))):
        one.report(1.0, "done")
        assert one == run
