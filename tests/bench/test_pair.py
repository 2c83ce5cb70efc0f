from __future__ import annotations

from argparse import ArgumentTypeError

import numpy as np
import pytest
from bench.cases.pairs import PAIRS, Pair
from bench.metrics import Score
from bench.pair_scores import PairResult, header, line, summary
from bench.tables import pair as pair_table

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

CAMERA = Camera.from_focal(300, 200, 300)
STEPS = grid_steps(CAMERA)


def row(fusion, other, off=0.3):
    names = ("blurred", "noisy", "denoised", "single", "uniform", "residual", "stopped")
    scores = {name: Score(other, 0.7) for name in names}
    scores |= {"fusion": Score(fusion, 0.8), "true": Score(fusion + 0.5, 0.82)}
    return PairResult(off, 500, 20.0, 0.99, 0.9, scores, {"kernel": 4.0})


def test_patterns_choose_cases():
    chosen = pair_table.chosen_cases("coffee 20 px*; *0.12")
    assert len(chosen) == 3 + 12 - 1
    assert chosen == [name for name in PAIRS if name in chosen]
    with pytest.raises(ArgumentTypeError, match="not among"):
        pair_table.chosen_cases("tea")


def head(*, blindly):
    return header(blindly=blindly, ways=pair_table.WAYS).splitlines()[1]


def test_ways_are_chosen():
    assert pair_table.chosen_ways("single") == ["single", "fusion", "true"]
    with pytest.raises(ArgumentTypeError, match="tea not among"):
        pair_table.chosen_ways("tea, single")
    assert header(blindly=False, ways=["fusion", "true"]).count("single") == 0


def test_the_table_has_a_cell_for_each_column():
    scored = row(30.0, 28.0)
    assert line("a case", scored).count("|") == head(blindly=False).count("|")
    scored.scores["blind"] = Score(25.0, 0.5)
    assert line("a case", scored).count("|") == head(blindly=True).count("|")


def test_the_summary_counts_from_the_scores():
    text = summary({"one": row(30.0, 28.0), "two": row(31.0, 31.5, off=6.0)})
    assert "median 6.30 px of 1000, worst 12.00; worst 0.30 of the blur, 1 beyond a quarter" in text
    assert "loss against the true one median 0.50 dB, mean 0.50, worst 0.50" in text
    assert (
        "fusion over denoised: mean +0.75 dB, +0.100; least -0.50 (two), +0.100; better in 1 of 2"
        in text
    )
    assert "overlap" not in text
    both = row(30.0, 28.0)
    both.scores.update({"fusion, overlap": Score(31, 0.8), "denoised, overlap": Score(30.5, 0.7)})
    line = "fusion over denoised, overlap: mean +0.50 dB, +0.100; least +0.50 (one)"
    assert line in summary({"one": both})
    assert "blind" not in text
    assert text.endswith("seconds: kernel 4.0")


def test_a_frame_is_misplaced_by_what_it_is_turned():
    kernel = RotationKernel.from_indices([[1, 0, 0], [1, 4, 0]], [1, 1], STEPS, CAMERA)
    black = np.zeros((200, 300, 3), np.float32)
    pair = Pair(black, black, kernel, np.zeros(3), black, None)
    assert pair.misplaced(kernel.centroid) == pytest.approx(0, abs=1e-9)
    turned = kernel.centroid + np.array([0, 2, 0]) * STEPS
    assert pair.misplaced(turned) == pytest.approx(2, rel=0.2)
