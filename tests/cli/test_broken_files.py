"""Broken files through the real commands, in child processes that may crash."""

from __future__ import annotations

import numpy as np
import pytest
from support import broken_files
from support.broken_files import Case, Outcome
from support.mutated_files import HEIGHT, WIDTH, bombs, mutated, seeds

from deshake.files.kernel_file import read_camera, read_kernel
from deshake.files.registration_file import read_registration
from deshake.formats.photo import read_photo

BOMBS = ("bomb-grey.png", "bomb-text.png", "bomb-size.jpg", "bomb-array.npz")
EVERY_SEED = 16


def test_no_broken_file_does_harm(tmp_path):
    todo = list(broken_files.cases(tmp_path, 2 * EVERY_SEED + 4, 7, with_bombs=BOMBS))
    outcomes = list(broken_files.run(todo))
    assert len(outcomes) == len(todo)
    assert not [(outcome, outcome.faults()) for outcome in outcomes if outcome.faults()]
    assert {outcome.code for outcome in outcomes} == {0, 1}
    assert all(outcome.code == 1 for outcome in outcomes if outcome.case.way == "bomb")


def test_the_seeds_are_sound(tmp_path):
    sound = seeds(tmp_path)
    assert len(sound) == EVERY_SEED
    for name, content in sound.items():
        path = tmp_path / name
        path.write_bytes(content)
        if path.suffix != ".npz":
            assert sorted(read_photo(path).shape) == [HEIGHT, WIDTH]
    assert read_kernel(tmp_path / "kernel.npz").confidence == 0.9
    assert read_camera(tmp_path / "camera.npz").source == "made"
    assert read_registration(tmp_path / "registration.npz").scale == 1


def test_equal_seeds_break_equally(tmp_path):
    sound = seeds(tmp_path)["a.png"]
    one, other, third = (mutated(sound, np.random.default_rng(seed)) for seed in (3, 3, 4))
    assert one == other != third
    assert one[1] != sound


def test_bombs_are_small(tmp_path):
    explosive = bombs(seeds(tmp_path))
    assert set(BOMBS) <= set(explosive)
    assert len(explosive["bomb-size.jpg"]()) < 10_000


def outcome(code=1, err="error: a: b\n", seconds=1.0, memory=1e8):
    return Outcome(Case("a", "flip", ("fix",)), code, err, seconds, memory)


@pytest.mark.parametrize(
    ("answer", "fault"),
    [
        (outcome(), None),
        (outcome(err="warning: c\nerror: a: b\nhint: d\n"), None),
        (outcome(code=0, err=""), None),
        (outcome(code=None), "crashed"),
        (outcome(code=2), "exit code 2"),
        (outcome(seconds=11.0), "11.0 s"),
        (outcome(memory=1.1e9), "1.10 GB"),
        (outcome(err=""), "0 lines of errors"),
        (outcome(err="error: a\nerror: b\n"), "2 lines of errors"),
        (outcome(err="error: a\nTraceback\n"), "neither errors"),
        (outcome(err="error: KeyError: 'x'\nhint: this is a bug\n"), "bug"),
    ],
)
def test_what_is_a_fault(answer, fault):
    assert bool(answer.faults()) == (fault is not None)
    assert fault is None or fault in "; ".join(answer.faults())


def test_a_child_that_dies_is_replaced():
    case = Case("a", "none", ("--version",))
    with broken_files._child() as child:
        child.kill()
        child.wait()
        assert broken_files._ask(child, case) is None
    assert [outcome.code for outcome in broken_files.run([case])] == [0]
