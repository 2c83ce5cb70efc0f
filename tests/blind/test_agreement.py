from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from deshake.blind.agreement import agreement, spread_px
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

CAMERA = Camera.from_focal(400.0, 300, 400)
STEPS = grid_steps(CAMERA)


def kernel(path: list[list[float]]) -> RotationKernel:
    """Make the kernel of a path in grid steps."""
    return RotationKernel.from_path(np.array(path) * STEPS, CAMERA).centred()


CURVE = [[-3.0, -8, -2], [1, 0, 0], [5, 2, 1], [4, 9, 3]]
MIRRORED = [[3.0, -8, -2], [-1, 0, 0], [-5, 2, 1], [-4, 9, 3]]
KERNELS = {
    "curve": kernel(CURVE),
    "mirrored": kernel(MIRRORED),
    "half": kernel([[x / 2 for x in at] for at in CURVE]),
    "pan": kernel([[0, -10, 0], [0, 10, 0]]),
    "tilt": kernel([[-10, 0, 0], [10, 0, 0]]),
    "roll": kernel([[0, 0, -10], [0, 0, 10]]),
    "still": RotationKernel.delta(CAMERA),
}


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_agrees_with_itself(name) -> None:
    assert agreement(KERNELS[name], KERNELS[name]) == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations(KERNELS, 2)))
def test_agreement_is_symmetric_and_less_for_others(one, other) -> None:
    agreements = agreement(KERNELS[one], KERNELS[other])
    assert agreements == pytest.approx(agreement(KERNELS[other], KERNELS[one]), abs=1e-4)
    assert 0 <= agreements < 0.9


@pytest.mark.parametrize("turn", [[0.0, 7, 0], [-3.5, 2.25, 0], [20, -30, 5]])
def test_a_shift_of_the_camera_changes_nothing(turn) -> None:
    curve = KERNELS["curve"]
    turned = replace(curve, theta=curve.theta + np.array(turn) * STEPS)
    assert agreement(turned, curve) > 0.99


def test_neighbouring_rotations_are_alike() -> None:
    curve = KERNELS["curve"]
    shaky = replace(
        curve,
        theta=curve.theta
        + np.random.default_rng(0).normal(scale=0.3, size=curve.theta.shape) * STEPS,
    )
    assert agreement(shaky, curve) > 0.97
    assert agreement(curve.resampled(1.5 * STEPS), curve) > 0.95


def test_the_more_a_kernel_is_off_the_less_it_agrees() -> None:
    agreements = [
        agreement(kernel([[x * share for x in at] for at in CURVE]), KERNELS["curve"])
        for share in (1.0, 0.9, 0.75, 0.5, 0.3)
    ]
    assert agreements == sorted(agreements, reverse=True)
    assert agreements[1] > 0.9


def test_more_smoothing_gives_more_agreement() -> None:
    agreements = [
        agreement(KERNELS["curve"], KERNELS["mirrored"], smoothing=s) for s in (0.1, 0.3, 1.0)
    ]
    assert agreements == sorted(agreements)
    assert agreements[0] < agreements[2]


def test_rotations_without_weight_do_not_count() -> None:
    curve = KERNELS["curve"]
    theta = np.concatenate([curve.theta, [[0.02, 0.03, 0]]])
    padded = replace(curve, theta=theta, weights=np.append(curve.weights, 0))
    assert agreement(padded, KERNELS["half"]) == pytest.approx(
        agreement(curve, KERNELS["half"]), abs=5e-3
    )


def test_wide_kernels_are_compared_as_narrow_ones_are() -> None:
    wide = [kernel([[5 * x for x in at] for at in path]) for path in (CURVE, MIRRORED)]
    assert agreement(wide[0], wide[0]) == pytest.approx(1, abs=1e-4)
    narrow = agreement(KERNELS["curve"], KERNELS["mirrored"])
    assert agreement(*wide) == pytest.approx(narrow, abs=0.1)


def test_kernels_of_very_different_widths_have_nothing_in_common() -> None:
    narrow = kernel([[0, -1, 0], [0, 1, 0]])
    assert agreement(narrow, KERNELS["pan"]) == 0
    assert agreement(KERNELS["still"], KERNELS["pan"]) == 0


def test_the_spread_is_that_of_what_is_moved() -> None:
    camera = Camera.uniform(300, 400)
    path = np.array([[0.0, -10, 0], [0, 10, 0]]) * grid_steps(camera)
    even = RotationKernel.from_path(path, camera)
    assert spread_px(even) == pytest.approx(20 / np.sqrt(12), rel=0.02)
    away = replace(even, theta=even.theta + 30 * grid_steps(camera))
    assert spread_px(away) == pytest.approx(spread_px(even), rel=1e-3)
    assert spread_px(KERNELS["still"]) == 0
