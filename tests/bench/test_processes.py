from __future__ import annotations

import os
import time
from operator import truediv

import pytest
from bench.processes import apart, completed, fastest, measured


def test_work_apart_has_a_process_of_its_own():
    assert apart(os.getpid) != os.getpid()
    with pytest.raises(ZeroDivisionError):
        apart(truediv, 1, 0)
    with pytest.raises(RuntimeError, match="was killed"):
        apart(os._exit, 3)


def test_every_task_is_completed():
    tasks = {"half": (1, 2), "third": (1, 3)}
    assert dict(completed(truediv, tasks, 2)) == {"half": 1 / 2, "third": 1 / 3}


def test_the_cost_is_that_of_the_work():
    result, cost = measured(lambda: time.sleep(0.05) or 7)
    assert result == 7
    assert 0.05 <= cost.seconds < 5
    assert cost.cpu < 0.05
    assert 0.01 < cost.peak_gb < 100


def test_the_fastest_of_the_repeats_counts():
    pauses = iter([0.2, 0.01])
    seconds = fastest({"a": lambda: time.sleep(next(pauses))}, 2)
    assert 0.01 <= seconds["a"] < 0.2
