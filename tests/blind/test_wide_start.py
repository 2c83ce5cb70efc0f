from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import scipy.fft

from deshake.blind import wide_start
from deshake.blind.agreement import agreement
from deshake.blind.settings import SETTINGS
from deshake.blind.wide_start import levels_on_frame, refined_on_frame, wide_starts
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.warps import Warps
from deshake.run import Run
from deshake.signal.gradients import differences
from deshake.signal.pyramid import Pyramid, Scale

ALL_AXES = True, True, True
PATH = np.array([[-6.0, -9.6, 0], [-6.0, 4.0, 0], [-2.0, 8.0, 0], [8.0, 9.6, 0]])  # in grid steps
REACH = 4


@pytest.fixture(scope="module")
def wide(shake):
    """A photo of 200 x 240 pixels, shaken by 19 pixels without roll."""
    return shake(Camera.from_focal(240.0, 200, 240), path=PATH)


@pytest.fixture(scope="module")
def thick(wide, widened):
    """The true kernel, smoothed by more than a grid step."""
    return widened(wide.kernel, 1.5)


@pytest.fixture(scope="module")
def starts(wide):
    return wide_starts(wide.pyramid, ALL_AXES, Run(1))


@pytest.fixture
def picture():
    picture = np.random.default_rng(1).random((60, 70), np.float32)
    return cv2.GaussianBlur(picture, (0, 0), 1.5)


@pytest.fixture
def frame(picture):
    """The frame of a random picture, in its own contrast."""
    scale = Scale(picture, Camera.from_focal(70.0, 60, 70), None, 1.0)
    return wide_start._Frame(scale, REACH, 1.0)


@pytest.fixture
def hook():
    """A small kernel that is not symmetric."""
    kernel = np.zeros((2 * REACH + 1, 2 * REACH + 1), np.float32)
    kernel[2, 3:7] = 0.15
    kernel[3:5, 6] = 0.2
    return kernel


def blurred(picture, kernel):
    """Move the light of a periodic picture by a kernel."""
    filled = wide_start._placed(kernel, picture.shape)
    spectrum = scipy.fft.rfft2(picture) * scipy.fft.rfft2(filled)
    return scipy.fft.irfft2(spectrum, s=picture.shape)


def rough_edges(frame):
    """Gradients that have power at all frequencies."""
    return differences(np.random.default_rng(3).random(frame.picture.shape, np.float32))


def test_a_known_wide_shake_is_recovered(wide, starts) -> None:
    assert [level for level, _ in starts] == [1, 0, 1, 1, 0]
    assert max(agreement(kernel, wide.kernel) for _, kernel in starts) > 0.95


def test_the_kernel_is_not_the_reflection_of_the_true_one(wide, starts) -> None:
    reflected = replace(wide.kernel, theta=-wide.kernel.theta)
    best = max((kernel for _, kernel in starts), key=lambda one: agreement(one, wide.kernel))
    assert agreement(best, wide.kernel) > agreement(best, reflected) + 0.15


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


@pytest.mark.parametrize("still", [0, 1])
def test_a_camera_that_turns_about_one_axis_moves_along_a_line(wide, still) -> None:
    axes = still != 0, still != 1, False
    kernels = [kernel for _, kernel in wide_starts(wide.pyramid, axes, Run(1))]
    for kernel in kernels:
        assert np.ptp(kernel.theta[:, still]) < 1e-2 * kernel.steps[still]
    other = 1 - still
    assert max(np.ptp(one.theta[:, other]) for one in kernels) > 10 * kernels[0].steps[other]


def test_a_tiny_photo_has_none(wide) -> None:
    small = Pyramid(wide.grey[:64, :80], Camera.from_focal(240.0, 64, 80))
    assert wide_starts(small, ALL_AXES, Run(1)) == []


def test_a_kernel_that_is_too_wide_is_refined_on_the_frame(wide, thick) -> None:
    kernel = refined_on_frame(wide.pyramid, thick, 2, SETTINGS.polish.frame[1], ALL_AXES)
    near = agreement(kernel, wide.kernel, smoothing=0.1)
    assert near > agreement(thick, wide.kernel, smoothing=0.1) + 0.02
    assert near > 0.9
    assert kernel.camera is wide.camera
    np.testing.assert_allclose(kernel.centroid, 0, atol=1e-3 * kernel.steps.min())


def test_a_part_of_a_path_becomes_the_whole(wide) -> None:
    part = RotationKernel.from_path(PATH[:2] * grid_steps(wide.camera), wide.camera).centred()
    assert agreement(part, wide.kernel) < 0.7
    for way in SETTINGS.growth.ways:
        kernel = refined_on_frame(wide.pyramid, part, 0, way, ALL_AXES)
        assert agreement(kernel, wide.kernel) > 0.95
        assert kernel.extent_px() > 1.5 * part.extent_px()


def test_faint_light_beyond_its_share_is_noise(wide, thick) -> None:
    way = SETTINGS.polish.frame[1]
    kernels = [
        refined_on_frame(wide.pyramid, thick, 2, replace(way, faint=faint), ALL_AXES)
        for faint in (0.1, 0.3, 0.5)
    ]
    counts = [np.count_nonzero(kernel.weights) for kernel in kernels]
    assert counts[0] > 1.2 * counts[1] > 1.2 * 1.2 * counts[2]


def test_a_camera_that_turns_about_one_axis_is_refined_along_a_line(wide, thick) -> None:
    kernel = refined_on_frame(
        wide.pyramid, thick, 2, SETTINGS.polish.frame[1], (False, True, False)
    )
    assert np.ptp(kernel.theta[:, 0]) < 1e-2 * kernel.steps[0]
    assert np.ptp(kernel.theta[:, 1]) > 5 * kernel.steps[1]


def test_a_frame_that_is_too_large_is_refined_at_coarser_scales(wide, thick) -> None:
    way = SETTINGS.polish.frame[1]
    assert levels_on_frame(wide.pyramid, 2, way) == (2, 0)
    way = replace(way, pixels=float(np.prod(wide.camera.shape)) / 2)
    assert levels_on_frame(wide.pyramid, 2, way) == (3, 1)
    kernel = refined_on_frame(wide.pyramid, thick, 2, way, ALL_AXES)
    assert kernel.steps == pytest.approx(grid_steps(wide.pyramid.camera_at(1)))
    assert agreement(kernel, wide.kernel) > 0.9
    beyond = wide.pyramid.coarsest + 2
    assert refined_on_frame(wide.pyramid, thick, beyond, way, ALL_AXES) is None


@pytest.mark.parametrize("faint", [0.05, 0.3])
def test_a_limit_of_light_keeps_a_faint_tail_with_much_of_it(faint) -> None:
    """A limit relative to the largest value discards all of the tail."""
    kernel = np.zeros((41, 41), np.float32)
    kernel[20, 2:39] = 0.4 / 37
    kernel[20, 2] = 0.6
    kernel[0, 0] = -0.1
    kept = wide_start._without_noise(kernel, 0.0, faint)
    assert kept[20, 2] == np.float32(0.6)
    assert np.count_nonzero(kept) == np.count_nonzero(kept > 0)
    lost = kernel[20].sum() - kept.sum()
    assert faint - 0.02 < lost / kernel[20].sum() < faint
    assert np.count_nonzero(wide_start._without_noise(kernel, 0.05, 0.0)) == 1


def test_the_filter_of_a_kernel_is_how_it_blurs_a_point() -> None:
    camera = Camera.from_focal(240.0, 201, 241)
    kernel = RotationKernel.from_path(PATH * grid_steps(camera), camera).centred()
    warps = Warps(camera, kernel.theta)
    point = np.zeros(warps.latent_shape, np.float32)
    point[tuple(n // 2 for n in point.shape)] = 1
    drawn = wide_start._filter(kernel, camera)
    reach = len(drawn) // 2
    blurred_point = warps.blur(point, kernel.weights)
    around = blurred_point[100 - reach : 101 + reach, 120 - reach : 121 + reach]
    np.testing.assert_allclose(drawn, around, atol=0.2 * around.max())
    assert np.abs(np.flip(drawn) - around).max() > 0.8 * around.max()


def test_the_frame_holds_the_picture_and_leads_to_its_other_side_beyond_it(frame, picture) -> None:
    np.testing.assert_array_equal(frame.picture[:60, :70], picture)
    around = np.concatenate([frame.picture[:60, 69:], frame.picture[:60, :1]], 1)
    assert np.ptp(np.diff(around, axis=1), axis=1).max() < 1e-6
    down = np.concatenate([frame.picture[59:], frame.picture[:1]])
    assert np.ptp(np.diff(down, axis=0), axis=0).max() < 1e-6


def test_the_kernel_step_finds_the_kernel_of_known_edges(frame, hook) -> None:
    edges = rough_edges(frame)
    frame.gradients = [scipy.fft.rfft2(blurred(edge, hook)) for edge in edges]
    np.testing.assert_allclose(frame.fitted(*edges, REACH), hook, rtol=0, atol=0.01)


def test_the_kernel_step_minimises_its_least_squares(frame, hook) -> None:
    edges, ridge = rough_edges(frame), SETTINGS.wide_start.ridge
    noise = np.random.default_rng(2)
    photo = [blurred(edge, hook) + noise.standard_normal(edge.shape) for edge in edges]
    frame.gradients = [scipy.fft.rfft2(part) for part in photo]
    whole = frame.fitted(*edges, min(frame.picture.shape) // 2 - 1)

    def energy(kernel):
        misfit = [blurred(edge, kernel) - part for edge, part in zip(edges, photo, strict=True)]
        return sum(np.square(part).sum() for part in misfit) + ridge * np.square(kernel).sum()

    for _ in range(5):
        step = 1e-3 * noise.standard_normal(whole.shape)
        assert energy(whole) < min(energy(whole + step), energy(whole - step))


def test_the_darkest_pixel_of_each_patch_becomes_black_if_it_is_dark(frame) -> None:
    latent = 0.5 + frame.picture
    latent[7, 9] = 0.05
    latent[50, 60] = 0.08
    darkened = frame._darkened(latent, 0.1)
    assert darkened[7, 9] == darkened[50, 60] == 0
    assert (darkened != latent).sum() == 2
    np.testing.assert_array_equal(frame._darkened(latent, 0.04), latent)


def test_edges_beyond_the_frame_do_not_count(frame, hook) -> None:
    across, down = frame.edges(hook / hook.sum(), 1e-4, 0.1)
    for part in (across, down):
        assert part.any()
        assert not part[59:].any()
        assert not part[:, 69:].any()


def test_small_values_and_pieces_are_discarded_and_the_kernel_is_centred(hook) -> None:
    noisy = hook.copy()
    noisy[8, 0] = 0.04  # a piece with less than a twentieth of the light
    noisy[0, 8] = -0.3
    noisy[7, 7] = 0.005
    noisy = wide_start._without_noise(noisy, 0.05, 0.0)
    cleaned = wide_start._cleaned(noisy, ALL_AXES, otherwise=hook)
    assert cleaned.sum() == pytest.approx(1)
    assert (cleaned > 0).sum() == (hook > 0).sum()
    steps = np.arange(-REACH, REACH + 1)
    assert max(abs(cleaned.sum(axis) @ steps) for axis in (0, 1)) <= 0.5


def test_a_step_that_finds_nothing_keeps_the_kernel(hook) -> None:
    assert wide_start._cleaned(np.zeros_like(hook), ALL_AXES, otherwise=hook) is hook
