from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.candidate import Candidate, edge_floor, refined
from deshake.blind.settings import SETTINGS, Refinement
from deshake.geometry.camera import Camera
from deshake.signal.pyramid import RATIO, Pyramid

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel


def run(candidate: Candidate) -> Candidate:
    while candidate.advance():
        pass
    return candidate


@pytest.fixture(scope="module")
def finished(pyramid) -> Candidate:
    return run(Candidate(pyramid, 3))


def test_a_known_shake_is_estimated(finished, shaken) -> None:
    assert finished.level == 0
    assert agreement(finished.kernel, shaken.kernel) > 0.9
    assert finished.kernel.camera is shaken.camera
    assert 0.7 < finished.width / shaken.kernel.extent_px() < 1.8


def test_a_thin_path_reaches_the_known_shake_too(finished, pyramid, shaken) -> None:
    thin = run(Candidate(pyramid, 3, SETTINGS.candidate.thin))
    assert thin.level == 0
    assert agreement(thin.kernel, shaken.kernel) > 0.9
    assert thin.kernel.weights.tobytes() != finished.kernel.weights.tobytes()


def test_a_wide_roll_is_estimated(shake) -> None:
    path = np.array([[-1.0, -2, -9], [0, 0, 0], [2, 1, 4], [1, 2, 12]])
    rolled = shake(Camera.from_focal(240.0, 200, 240), path)
    kernels = run(Candidate(rolled.pyramid, 3)).kernel, rolled.kernel
    deviations = [np.sqrt(np.diag(np.cov(k.theta.T, aweights=k.weights))) for k in kernels]
    assert deviations[0][2] == pytest.approx(deviations[1][2], rel=0.25)
    assert agreement(*kernels) > 0.93


def test_the_kernel_is_centred_and_whole(finished) -> None:
    kernel = finished.kernel
    np.testing.assert_allclose(kernel.centroid, 0, atol=1e-3 * kernel.steps.min())
    assert kernel.weights.sum() == pytest.approx(1)
    assert kernel.weights.min() > 0


def test_it_goes_from_scale_to_scale(pyramid, shaken) -> None:
    candidate = Candidate(pyramid, 2)
    with pytest.raises(ValueError, match="no scale"):
        _ = candidate.kernel
    for level in (2, 1, 0):
        assert candidate.advance()
        assert candidate.level == level
        kernel = candidate.kernel
        assert kernel.camera is shaken.camera
        pixels = kernel.steps[0] / shaken.kernel.steps[0]
        assert pixels == pytest.approx(RATIO**level, rel=0.02)
    assert not candidate.advance()
    assert candidate.level == 0


def test_uniform_blur_does_not_roll(shake) -> None:
    camera = Camera.uniform(150, 180)
    shaken = shake(camera, np.array([[-1.0, -4, 0], [0, 0, 0], [2, 1, 0], [1, 4, 0]]))
    kernel = run(Candidate(shaken.pyramid, 3)).kernel
    assert not kernel.theta[:, 2].any()
    assert agreement(kernel, shaken.kernel) > 0.9


def test_the_camera_turns_about_the_axes_that_it_may(pyramid) -> None:
    quick = replace(SETTINGS.candidate.fine, iterations=2)
    level = run(Candidate(pyramid, 2, quick, axes=(True, True, False))).kernel
    assert np.ptp(level.theta[:, 2]) < 0.05 * level.steps[2]
    pan = run(Candidate(pyramid, 2, quick, axes=(False, True, False))).kernel
    assert np.ptp(pan.theta[:, 0]) < 0.05 * pan.steps[0]
    assert np.ptp(pan.theta[:, 1]) > pan.steps[1]


def test_the_blur_stays_within_its_bound(pyramid, finished) -> None:
    narrow = run(Candidate(pyramid, 3, bound=2.0)).kernel
    ranges = [np.ptp(k.theta, axis=0) / k.steps for k in (narrow, finished.kernel)]
    assert ranges[0].max() < 2 * 3 + 0.5
    assert ranges[1].max() > 2 * 3 + 0.5


def test_a_kernel_too_wide_stops_where_it_is(pyramid) -> None:
    candidate = run(Candidate(pyramid, 4, replace(SETTINGS.candidate.fine, wide=8.0)))
    assert candidate.level > 0
    assert candidate.width * RATIO > 8


def test_exposure_does_not_count(shaken, finished) -> None:
    darker = Pyramid(shaken.grey / 4, shaken.camera)  # by a power of two, nearly exactly
    assert agreement(run(Candidate(darker, 3)).kernel, finished.kernel) > 0.97


def test_an_edge_must_be_above_the_noise(shaken, pyramid) -> None:
    grain = np.random.default_rng(1).normal(0, 0.03, shaken.grey.shape).astype(np.float32)
    noisy = Pyramid(shaken.grey + grain, shaken.camera)
    assert edge_floor(noisy, 0) > 10 * edge_floor(pyramid, 0)
    assert edge_floor(noisy, 3) < edge_floor(noisy, 0)
    assert edge_floor(noisy, 0, 20) == pytest.approx(2 * edge_floor(noisy, 0, 10))


@pytest.fixture(scope="module")
def rough(shaken) -> RotationKernel:
    """The shake as a much coarser scale would estimate it."""
    return shaken.kernel.resampled(4 * shaken.kernel.steps).centred()


@pytest.mark.parametrize("part", ["fitted", "apart"])
def test_refinement_comes_nearer_the_truth(pyramid, shaken, rough, part) -> None:
    fine = refined(pyramid, rough, 0, Refinement(2e-3, iterations=3), part=part)
    before = agreement(rough, shaken.kernel, smoothing=0.15)
    assert agreement(fine, shaken.kernel, smoothing=0.15) > before + 0.03
    assert fine.camera is shaken.camera
    np.testing.assert_allclose(fine.centroid, 0, atol=1e-3 * fine.steps.min())


def test_refinement_keeps_to_its_scale_and_axes(pyramid, rough) -> None:
    how = Refinement(1e-2, iterations=2)
    coarse = refined(pyramid, rough, 2, how, axes=(True, True, False))
    assert coarse.steps[0] == pytest.approx(rough.steps[0] / 2, rel=0.02)
    assert np.ptp(coarse.theta[:, 2]) < 0.05 * coarse.steps[2]


def test_the_same_each_time(shaken, finished) -> None:
    again = run(Candidate(shaken.pyramid, 3)).kernel
    assert again.theta.tobytes() == finished.kernel.theta.tobytes()
    assert again.weights.tobytes() == finished.kernel.weights.tobytes()
