from __future__ import annotations

import argparse

import pytest
from bench.tables.focal import Exposure, Scores, Trial, line, numbers, summary

FACTORS = (0.5, 1.0, 2.0)
TABLE = [
    Scores(8.0, 20.0, (Trial(1.0, 0.1), Trial(5.0, 0.3), Trial(4.0, 0.2))),
    Scores(6.0, 10.0, (Trial(2.0, 0.1), Trial(3.0, 0.2), Trial(4.0, 0.25))),
]


def test_the_highest_confidence_is_taken():
    assert [scores.judged for scores in TABLE] == [1, 2]
    shown = line(Exposure("coffee", 1), TABLE[1], FACTORS)
    assert shown.endswith("| +4.00 (x2) |")
    assert "| +3.00 (-1.4) |" in shown


def test_losses_are_relative_to_the_true_focal_length():
    text = summary(TABLE, FACTORS)
    assert "x0.5: -2.50 dB on the mean, median -2.50, worst -4.00" in text
    assert "judged: +0.50 dB on the mean" in text
    assert "the judge takes x0.5 0 times, x1 1 times, x2 1 times" in text


@pytest.mark.parametrize("text", ["0.5,2", "-1,1", "0,1"])
def test_the_true_focal_length_is_among_the_factors(text):
    assert numbers("0.5,1") == [0.5, 1.0]
    with pytest.raises(argparse.ArgumentTypeError):
        numbers(text)


def test_lenses_take_turns():
    shakes = [Exposure("coffee", window).shake(0) for window in (0, 1, 2)]
    assert [shake.focal for shake in shakes] == [0.75, 1.39, 0.75]
    assert len({shake.seed for shake in shakes}) == 3
    assert all(10 <= shake.extent <= 40 for shake in shakes)
    assert shakes[0] == Exposure("coffee", 0).shake(0)
