from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.wide_start import wide_starts
from deshake.geometry.camera import Camera
from deshake.run import Run
from deshake.signal.pyramid import Pyramid

ALL_AXES = True, True, True
PATH = np.array([[0.0, -9.6, 0], [3.2, -2.4, 0], [-1.6, 3.2, 0], [2.4, 9.6, 0]])  # in grid steps


@pytest.fixture(scope="module")
def wide(shake):
    """A photo of 200 x 240 pixels, shaken by 19 pixels without roll."""
    return shake(Camera.from_focal(240.0, 200, 240), path=PATH)


@pytest.fixture(scope="module")
def starts(wide):
    return wide_starts(wide.pyramid, ALL_AXES, Run(1))


def test_a_known_wide_shake_is_recovered(wide, starts) -> None:
    assert [level for level, _ in starts] == [0, 0, 1, 1]
    assert max(agreement(kernel, wide.kernel) for _, kernel in starts) > 0.95


def test_kernels_are_centred_without_roll_and_belong_to_the_photo(wide, starts) -> None:
    for _, kernel in starts:
        assert kernel.camera is wide.camera
        assert kernel.weights.sum() == pytest.approx(1)
        np.testing.assert_allclose(kernel.centroid, 0, atol=1e-3 * kernel.steps.min())
        assert np.ptp(kernel.theta[:, 2]) < 0.05 * kernel.steps[2]


def test_threads_change_nothing(wide, starts) -> None:
    for (_, one), (_, two) in zip(starts, wide_starts(wide.pyramid, ALL_AXES, Run(2)), strict=True):
        assert one.theta.tobytes() == two.theta.tobytes()
        assert one.weights.tobytes() == two.weights.tobytes()


def test_a_camera_that_turns_about_one_axis_moves_along_a_line(wide) -> None:
    _, kernel = wide_starts(wide.pyramid, (False, True, False), Run(1))[0]
    assert np.ptp(kernel.theta[:, 0]) < 1e-2 * kernel.steps[0]
    assert np.ptp(kernel.theta[:, 1]) > 10 * kernel.steps[1]


def test_a_tiny_photo_has_none(wide) -> None:
    small = Pyramid(wide.grey[:64, :80], Camera.from_focal(240.0, 64, 80))
    assert wide_starts(small, ALL_AXES, Run(1)) == []
