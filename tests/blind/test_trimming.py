from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.trimming import (
    heaviest,
    main_piece,
    most_of,
    strongest,
    without_light,
    without_strays,
)
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

CAMERA = Camera.from_focal(130.0, 90, 120)


def kernel(weights):
    """Make a kernel of grid indices and their weights."""
    steps = grid_steps(CAMERA)
    return RotationKernel.from_indices(list(weights), list(weights.values()), steps, CAMERA)


def indices(trimmed):
    return {tuple(i) for i in trimmed.indices.tolist()}


PATH = {(0, 0, 0): 5, (0, 1, 0): 3, (1, 2, 1): 2, (1, 4, 1): 2}


def test_the_strongest_are_kept():
    trimmed = strongest(kernel(PATH), 2)
    assert indices(trimmed) == {(0, 0, 0), (0, 1, 0)}
    np.testing.assert_allclose(trimmed.weights, [5 / 8, 3 / 8])
    whole = kernel(PATH)
    assert strongest(whole, 4) is whole


@pytest.mark.parametrize(("share", "count"), [(0, 4), (0.1, 4), (0.2, 3), (0.4, 2), (0.9, 1)])
def test_the_lightest_are_dropped_that_hold_less_than_a_share(share, count):
    trimmed = heaviest(kernel(PATH), share)
    assert len(trimmed.weights) == count
    assert trimmed.weights.sum() == pytest.approx(1)


def test_a_long_faint_tail_is_kept_beside_a_bright_point():
    weights = np.array([60.0] + 40 * [1.0])
    np.testing.assert_array_equal(without_light(weights, 0.005), weights)
    dropped = without_light(weights, 0.03)
    assert dropped.sum() > 0.97 * weights.sum()
    assert (dropped == 0).sum() == 2
    assert (weights > 0).all()  # the weights given stay as they are


@pytest.mark.parametrize(("heavy", "count"), [(5, 3), (92, 1)])
def test_most_of_a_kernel_holds_most_of_its_weight(heavy, count):
    whole = kernel(PATH | {(0, 0, 0): heavy})
    trimmed = most_of(whole)
    assert len(trimmed.weights) == count
    assert np.sort(whole.weights)[::-1][:count].sum() >= 0.8


def test_strays_are_dropped_and_gaps_are_none():
    far = {(9, -9, 3): 0.1, (9, -9, 4): 0.1}
    trimmed = without_strays(kernel(PATH | far))
    assert indices(trimmed) == set(PATH)
    assert trimmed.weights.sum() == pytest.approx(1)


def test_what_lies_apart_but_is_heavy_stays():
    far = {(9, -9, 3): 0.5, (9, -9, 4): 0.5}
    assert indices(without_strays(kernel(PATH | far))) == set(PATH) | set(far)


def test_a_kernel_all_in_pieces_stays_whole():
    scattered = {(5 * i, 0, 0): 1 for i in range(40)}
    whole = kernel(scattered)
    assert without_strays(whole) is whole


def test_the_main_piece_is_the_heaviest_that_hangs_together():
    far = {(9, -9, 3): 4, (9, -9, 4): 4}
    trimmed = main_piece(kernel(PATH | far))
    assert indices(trimmed) == set(PATH)
    assert trimmed.weights.sum() == pytest.approx(1)
    assert indices(main_piece(kernel(PATH | dict.fromkeys(far, 9)))) == set(far)
