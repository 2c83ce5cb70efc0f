from __future__ import annotations

import argparse

import numpy as np
import pytest
from benchmark_blind import Case
from benchmark_focal import Scores, Trial, line, main, margin, numbers, summary

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel

FACTORS = (0.5, 1.0, 2.0)
TABLE = [
    Scores(8.0, 20.0, (Trial(1.0, 0.1), Trial(5.0, 0.3), Trial(4.0, 0.2))),
    Scores(6.0, 10.0, (Trial(2.0, 0.1), Trial(3.0, 0.2), Trial(4.0, 0.25))),
]


def test_the_judge_takes_the_largest_margin():
    assert [scores.judged for scores in TABLE] == [1, 2]
    assert line(Case("coffee", 1), TABLE[1], FACTORS).endswith("| +4.00 (x2) |")


def test_losses_are_told_against_the_true_focal_length():
    text = summary(TABLE, FACTORS)
    assert "x0.5: -2.50 dB on the mean, median -2.50, worst -4.00" in text
    assert "judged: +0.50 dB on the mean" in text
    assert "the judge takes x0.5 0 times, x1 1 times, x2 1 times" in text


@pytest.mark.parametrize("text", ["0.5,2", "-1,1", "0,1"])
def test_the_true_focal_length_is_among_the_factors(text):
    assert numbers("0.5,1") == [0.5, 1.0]
    with pytest.raises(argparse.ArgumentTypeError):
        numbers(text)


def test_missing_data_are_told(tmp_path, capsys):
    assert main(["--data", str(tmp_path)]) == 1
    assert "no orientation logs" in capsys.readouterr().err


def test_the_margin_is_the_judges_against_no_shake():
    squares = np.kron(np.random.default_rng(0).random((8, 12)), np.ones((10, 10))).astype(
        np.float32
    )
    known = np.ones(squares.shape, bool)
    still = RotationKernel.delta(Camera.from_focal(120, 80, 120))
    turning = np.stack([np.zeros(9), np.linspace(-0.05, 0.05, 9), np.zeros(9)], 1)
    wide = RotationKernel.from_path(turning, still.camera)
    assert margin(squares, still, known) == 0
    assert margin(squares, wide, known) < 0  # the squares are sharp as they are
