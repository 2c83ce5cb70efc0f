from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deshake.blind.narrowing import narrower, narrowest
from deshake.blind.settings import SETTINGS
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps

CAMERA = Camera.from_focal(500.0, 360, 560)
STEPS = grid_steps(CAMERA)


def band(axes: np.ndarray, spreads: tuple[float, float, float]) -> RotationKernel:
    """A cloud of rotations with standard deviations, in grid steps, along orthogonal axes."""
    random = np.random.default_rng(3)
    places = random.standard_normal((4000, 3)) * spreads @ axes.T
    weights = np.full(len(places), 1 / len(places))
    return RotationKernel(places * STEPS, weights, STEPS, CAMERA).resampled(STEPS)


def spreads_along(kernel: RotationKernel, axes: np.ndarray) -> np.ndarray:
    """The standard deviations of a kernel along axes, in grid steps."""
    places = (kernel.theta - kernel.centroid) / kernel.steps @ axes
    return np.sqrt(kernel.weights @ places**2)


@pytest.fixture(scope="module")
def axes() -> np.ndarray:
    return np.linalg.qr(np.array([[3.0, 1, 1], [2, -1, 0], [1, 2, -4]]))[0]


def test_kernels_become_narrower_across_their_longest_axis_alone(axes) -> None:
    kernel = band(axes, (9.0, 4.0, 3.0))
    before = spreads_along(kernel, axes)
    results = narrower(kernel)
    assert len(results) == len(SETTINGS.narrowing.shares)
    within = 1 / 6 + 0.05  # the mean square of the spread over the cells of the grid
    for share, narrow in zip(SETTINGS.narrowing.shares, results, strict=True):
        after = spreads_along(narrow, axes)
        assert after[0] == pytest.approx(before[0], rel=0.01)
        assert after[1:] ** 2 == pytest.approx((share * before[1:]) ** 2, abs=within)


def test_narrower_kernels_are_centred_and_keep_weight_and_grid(axes) -> None:
    kernel = band(axes, (9.0, 3.0, 2.0))
    moved = replace(kernel, theta=kernel.theta + [4, -3, 2] * STEPS)
    for narrow in narrower(moved):
        np.testing.assert_allclose(narrow.centroid, 0, atol=1e-9)
        np.testing.assert_allclose(narrow.steps, STEPS)
        assert narrow.weights.sum() == pytest.approx(1)
        assert narrow.camera == CAMERA
        np.testing.assert_allclose(narrow.theta / STEPS, narrow.indices, atol=1e-6)


def test_no_kernel_becomes_narrower_than_a_thin_path(axes) -> None:
    least, shares = SETTINGS.narrowing.least_width, SETTINGS.narrowing.shares
    kernel = band(axes, (9.0, 1.5, 0.5))
    second = spreads_along(kernel, axes)[1]
    results = narrower(kernel)
    assert len(results) == sum(share * second >= least for share in shares)
    assert 0 < len(results) < len(shares)
    assert narrower(band(axes, (9.0, 0.7, 0.5))) == []
    assert narrower(RotationKernel.delta(CAMERA)) == []


def test_a_camera_that_does_not_roll_does_not_begin_to(axes) -> None:
    kernel = band(axes, (9.0, 3.0, 2.0))
    flat = replace(kernel, theta=kernel.theta * [1, 1, 0])
    assert all(np.all(narrow.theta[:, 2] == 0) for narrow in narrower(flat))
    assert len(narrower(flat)) > 0


def test_the_longest_axis_is_measured_in_grid_steps() -> None:
    """A roll of fewer steps is a larger angle, but a shorter path on the frame."""
    kernel = band(np.eye(3), (6.0, 2.0, 4.0))
    assert (STEPS[2] * 4) > (STEPS[0] * 6)
    after = spreads_along(narrower(kernel)[-1], np.eye(3))
    assert after[0] == pytest.approx(6.0, rel=0.05)
    assert after[2] < 0.3 * 4 + 0.5


def test_the_narrowest_kernel_within_the_tolerance_is_chosen() -> None:
    tolerance = SETTINGS.narrowing.tolerance
    below = 1 - 0.9 * tolerance
    assert narrowest(np.array([1.0, 0.5, 0.2])) == 0
    assert narrowest(np.array([1.0, below, 0.2])) == 1
    assert narrowest(np.array([1.0, 0.5, below, 1 - 1.1 * tolerance])) == 2
    assert narrowest(np.array([below, 0.2, 1.0, 0.3])) == 2
    assert narrowest(np.array([0.3])) == 0


def test_the_tolerance_counts_from_the_best_kernel_of_all() -> None:
    tolerance = SETTINGS.narrowing.tolerance
    rising = 1 + np.array([0, 0.6, 1.2, 0.6, 0.1]) * tolerance
    assert narrowest(rising) == 3
