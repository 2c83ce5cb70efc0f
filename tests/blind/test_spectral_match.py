from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deshake.blind.agreement import agreement
from deshake.blind.camera_path import SmoothPath
from deshake.blind.spectral_match import SpectralMatch, descended, match_of_path, traced
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import displacements, grid_steps, homographies
from deshake.signal.pyramid import Pyramid

FINE = 0.1  # share of the kernel's spread: smoothing of a strict agreement


@pytest.fixture(scope="module")
def match(pyramid) -> SpectralMatch:
    return SpectralMatch(pyramid, 0, "all")


@pytest.fixture(scope="module")
def bent(shaken) -> RotationKernel:
    """The true path, its parts moved by about two pixels."""
    steps = grid_steps(shaken.camera)
    path = np.array([[-3.0, -4, -2], [1, -1, 0], [1, 3, 0], [3, 4, 3]]) * steps
    return RotationKernel.from_path(path, shaken.camera).centred()


def test_the_true_kernel_matches_best(match, shaken, bent) -> None:
    true = shaken.kernel
    twice = replace(true, theta=2 * true.theta)
    mirrored = replace(true, theta=true.theta * [1, -1, 1])
    values = [match.value(kernel) for kernel in (true, bent, twice, mirrored)]
    assert values[0] > 0.2
    assert np.argmax(values) == 0
    assert max(np.abs(values)) <= 1


def test_a_kernel_turned_by_half_a_turn_matches_as_well(match, shaken) -> None:
    turned = replace(shaken.kernel, theta=-shaken.kernel.theta)
    assert match.value(turned) == pytest.approx(match.value(shaken.kernel), abs=0.02)


def test_a_kernel_may_be_moved(match, shaken) -> None:
    moved = replace(shaken.kernel, theta=shaken.kernel.theta + 3 * shaken.kernel.steps)
    assert match.value(moved) == pytest.approx(match.value(shaken.kernel), abs=0.02)


def test_a_camera_at_rest_matches_nothing(match, shaken) -> None:
    assert match.value(RotationKernel.delta(shaken.camera)) == pytest.approx(0, abs=1e-3)


def test_noise_matches_nothing(shaken) -> None:
    grain = np.random.default_rng(1).normal(0.5, 0.05, shaken.camera.shape).astype(np.float32)
    noise = SpectralMatch(Pyramid(grain, shaken.camera), 0, "all")
    assert abs(noise.value(shaken.kernel)) < 0.1


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("when", [3, 20, 44])
def test_the_gradient_is_that_of_finite_differences(match, bent, axis, when) -> None:
    path = SmoothPath.through(bent, match.camera)[0]
    rotations = path.basis(48) @ path.controls
    gradient = match.of_rotations(rotations)[1]
    step = np.zeros_like(rotations)
    step[when, axis] = 1e-2
    change = (
        match.of_rotations(rotations + step)[0] - match.of_rotations(rotations - step)[0]
    ) / 2e-2
    assert change == pytest.approx(gradient[when, axis], rel=0.1, abs=1e-4)


def test_a_strong_fluctuation_of_one_frequency_counts_little(shaken) -> None:
    waves = 0.2 * np.sin(np.arange(shaken.camera.width) * 2 * np.pi * 0.2)
    grey = shaken.pyramid.at(0).picture + waves.astype(np.float32)
    striped = SpectralMatch(Pyramid(grey, shaken.camera), 0, "all")
    assert np.abs(striped.observed).max() < 0.1  # of a norm of 1
    assert striped.value(shaken.kernel) > 0.1


def test_a_path_that_is_nearly_right_comes_nearer_to_the_truth(match, shaken, bent) -> None:
    fitted = match.fitted(bent)
    assert match.value(fitted) > match.value(bent) + 0.02
    near = agreement(fitted, shaken.kernel, smoothing=FINE)
    assert near > agreement(bent, shaken.kernel, smoothing=FINE) + 0.02
    assert fitted.camera is bent.camera
    assert fitted.weights.sum() == pytest.approx(1)


def test_tiles_that_the_path_was_not_fitted_to_match_better_too(shaken, bent) -> None:
    pyramid = shaken.pyramid
    fitted = SpectralMatch(pyramid, 0, "fitted").fitted(bent)
    apart = SpectralMatch(pyramid, 0, "apart")
    assert apart.value(fitted) > apart.value(bent)


def test_a_place_where_an_estimate_rests_too_long_becomes_lighter(match, shaken) -> None:
    true = shaken.kernel
    weights = true.weights.copy()
    weights[len(weights) // 3] += 0.5
    spiked = replace(true, weights=weights / weights.sum())
    fitted = match.fitted(spiked)
    before, after = (agreement(k, true, smoothing=FINE) for k in (spiked, fitted))
    assert after > before + 0.03


def test_weights_that_are_a_little_wrong_come_nearer_to_the_truth(match, shaken) -> None:
    true = shaken.kernel
    noise = np.random.default_rng(2).uniform(0.3, 1.7, len(true.weights))
    wrong = replace(true, weights=true.weights * noise / (true.weights @ noise))
    weighed = match.weighed(wrong)
    assert match.value(weighed) > match.value(wrong) + 0.02
    assert weighed.weights.sum() == pytest.approx(1)
    assert weighed.weights.min() >= 0
    assert weighed.camera is true.camera


def test_the_weights_of_a_point_do_not_change(match, shaken) -> None:
    point = RotationKernel.delta(shaken.camera)
    assert match.weighed(point).weights.tolist() == [1]


def test_a_path_without_roll_gets_none(match, bent) -> None:
    flat = replace(bent, theta=bent.theta * [1, 1, 0])
    fitted = match.fitted(flat)
    assert np.ptp(fitted.theta[:, 2]) < 0.1 * fitted.steps[2]


def test_a_point_stays_a_point(match, shaken) -> None:
    point = RotationKernel.delta(shaken.camera)
    assert match.fitted(point) is point


def test_a_photo_smaller_than_a_tile_is_one_tile(shake) -> None:
    small = shake().pyramid.at(3)
    pyramid = Pyramid(small.picture, small.camera)
    tiny = SpectralMatch(pyramid, 0, "all")
    assert tiny.size == min(small.camera.shape) // 2 * 2
    assert len(tiny.centres) >= 1


def test_a_path_matches_as_its_kernel_does(match, bent) -> None:
    path = SmoothPath.through(bent, match.camera)[0]
    assert match.of_path(path) == pytest.approx(match.value(path.kernel(match.camera)), abs=0.02)


def test_a_descent_ends_at_a_path_that_matches_better(match, bent) -> None:
    path = SmoothPath.through(bent, match.camera)[0]
    worth, end = descended([match], path, 10)
    assert match.of_path(end) > match.of_path(path) + 0.02
    assert worth <= match.of_path(end)  # bends have a price


def test_tracks_are_the_displacements_of_the_centres(match, bent) -> None:
    path = SmoothPath.through(bent, match.camera)[0]
    tracks = match.tracks(path, 20)
    rotations = path.basis(20) @ path.controls * grid_steps(match.camera)
    exact = displacements(homographies(match.camera, rotations), match.centres)
    exact -= exact.mean(1, keepdims=True)
    np.testing.assert_allclose(tracks, exact, atol=0.1)


def test_a_descent_at_several_scales_raises_their_mean_match(pyramid, bent) -> None:
    scales = [SpectralMatch(pyramid, level, "all") for level in (0, 1)]
    path = SmoothPath.through(bent, scales[-1].camera)[0]

    def mean(path: SmoothPath) -> float:
        return float(np.mean([one.of_path(path.on_scale(one.camera)) for one in scales]))

    worth, end = descended(scales, path, 10)
    assert mean(end) > mean(path) + 0.02
    assert worth == pytest.approx(mean(end), abs=0.02)
    assert worth <= mean(end) + 1e-6  # bends have a price


def test_the_match_of_a_path_is_the_mean_of_the_scales_and_has_its_gradient(pyramid, bent) -> None:
    scales = [SpectralMatch(pyramid, level, "all") for level in (0, 1)]
    path = SmoothPath.through(bent, scales[-1].camera)[0]
    match, slope = match_of_path(scales, path)
    singly = [one.of_path(path.on_scale(one.camera)) for one in scales]
    assert match == pytest.approx(np.mean(singly), abs=0.005)
    change = np.random.default_rng(0).normal(0, 0.01, path.controls.shape)
    there, back = (
        match_of_path(scales, path._replace(controls=path.controls + sign * change))[0]
        for sign in (1, -1)
    )
    assert (there - back) / 2 == pytest.approx(float(np.vdot(slope, change)), rel=0.1)


def test_a_traced_path_comes_nearer_to_the_truth(shake) -> None:
    path = np.array([[0.0, -14, -4], [5, -4, 0], [-2, 4, 1], [3, 14, 4]])
    photo = shake(Camera.from_focal(420.0, 360, 420), path=path)
    moved = path + np.array([[-2, 1, 0], [1, 2, 0], [1, -2, 0], [2, 1, 0]])
    wrong = RotationKernel.from_path(moved * grid_steps(photo.camera), photo.camera).centred()
    scales = [SpectralMatch(photo.pyramid, level, "fitted") for level in (0, 1)]
    early, late = traced(scales, wrong)
    before = agreement(wrong, photo.kernel, smoothing=FINE)
    for one in (early, late):
        assert agreement(one, photo.kernel, smoothing=FINE) > before + 0.02
        assert one.camera is wrong.camera
    values = [np.mean([one.value(kernel) for one in scales]) for kernel in (wrong, early, late)]
    assert values == sorted(values)


def test_nothing_is_traced_along_a_point(match, shaken) -> None:
    assert traced([match], RotationKernel.delta(shaken.camera)) == []
