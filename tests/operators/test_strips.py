from __future__ import annotations

import threading
import time

import pytest

from deshake.operators.strips import Strip, bands, in_order, reported, with_halo
from deshake.run import Run

STRIPS = [Strip(row, 0, 4) for row in range(30)]


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_results_come_in_order(threads: int) -> None:
    def work(strip: Strip) -> int:
        time.sleep(0.002 * (strip.row % 3 == 0))
        return strip.row**2

    assert list(in_order(work, STRIPS, Run(threads))) == [(s, s.row**2) for s in STRIPS]


def test_work_is_shared_by_the_threads() -> None:
    both = threading.Barrier(2, timeout=60)
    list(in_order(lambda _: both.wait(), STRIPS[:2], Run(2)))


def test_few_results_wait_at_once() -> None:
    started: list[Strip] = []
    results = in_order(started.append, STRIPS, Run(2))
    next(results)
    time.sleep(0.05)
    assert len(started) < len(STRIPS) // 2
    results.close()  # what has not begun is cancelled
    time.sleep(0.05)
    assert len(started) < len(STRIPS) // 2


@pytest.mark.parametrize("threads", [1, 3])
def test_errors_reach_the_caller(threads: int) -> None:
    def work(strip: Strip) -> None:
        if strip.row == 7:
            message = "strip seven"
            raise ArithmeticError(message)

    with pytest.raises(ArithmeticError, match="strip seven"):
        list(in_order(work, STRIPS, Run(threads)))
    assert len(list(in_order(lambda _: None, STRIPS, Run(threads)))) == len(STRIPS)


def test_part_of_a_strip() -> None:
    assert Strip(3, 10, 20).part(2, 5) == Strip(3, 12, 15)
    assert Strip(3, 10, 20).count == 10


def test_bands_cover_all_rows_once():
    assert [(rows.start, rows.stop) for rows in bands(10, 4)] == [(0, 4), (4, 8), (8, 10)]
    assert bands(3, 4) == [slice(0, 3)]


@pytest.mark.parametrize("halo", [0, 2, 30])
def test_a_band_lies_within_its_halo(halo: int) -> None:
    rows = list(range(11))
    for band in bands(11, 4):
        around, own = with_halo(band, halo, 11)
        assert rows[around][own] == rows[band]
        assert around == slice(max(band.start - halo, 0), min(band.stop + halo, 11))


@pytest.mark.parametrize("threads", [1, 3])
def test_reports_the_share_that_is_done(threads: int) -> None:
    heard: list[tuple[float, str]] = []
    run = Run(threads, lambda share, text: heard.append((share, text)))
    assert list(reported(abs, [-1, 2, -3, 4], run, "step")) == [(-1, 1), (2, 2), (-3, 3), (4, 4)]
    assert heard == [(0.25, "step"), (0.5, "step"), (0.75, "step"), (1.0, "step")]
