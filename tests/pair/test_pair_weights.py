from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import reach
from deshake.operators.planes import fitted
from deshake.operators.shake_blur import blur_filters
from deshake.pair.pair_weights import agreement, blurred_variance, denoising_error

SIGMA = 0.05


@pytest.fixture(scope="module")
def pair(lab):
    """The sharp frame, the blurred photo and the noisy one, denoised."""
    sharp = lab.colours()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.002)
    frame = np.ascontiguousarray(lab.frame(sharp))
    f_N = frame + np.random.default_rng(3).normal(0, SIGMA, frame.shape).astype(np.float32)
    return frame, g, lab.noisy_photo(g, f_N)


def variance(lab, pair, kernel):
    _, g, noisy = pair
    margin = reach(kernel.camera, kernel.theta)
    blur = blur_filters(kernel, margin=margin, channels=3)
    size = tuple(side + 2 * margin for side in lab.shape)
    pixels, denoised = (fitted(planes, size) for planes in (noisy.pixels, noisy.denoised))
    noisy = replace(noisy, pixels=pixels, denoised=denoised)
    Af = blur.forward(denoised)
    ones = np.ones(lab.shape, np.float32)
    return blurred_variance(g, Af, noisy, ones, blur=blur, margin=margin)


def test_a_wrong_kernel_shows_in_the_variance(lab, pair):
    right = variance(lab, pair, lab.all_axes)
    wrong = variance(lab, pair, RotationKernel.delta(lab.camera))
    assert np.median(np.sqrt(right)) < 0.012
    assert np.median(wrong) > 10 * np.median(right)
    assert right.min() > 0


def test_the_error_of_denoising_is_least_where_the_scene_is_even(pair):
    frame, _, noisy = pair
    error = denoising_error(noisy)
    true = np.square(noisy.denoised - np.moveaxis(frame, -1, 0)).mean(0)
    calm = error <= np.quantile(error, 0.3)
    assert true[calm].mean() < 0.7 * true[error > np.quantile(error, 0.9)].mean()
    assert error.min() >= 0.3 - 1e-6


def test_photos_that_show_the_same_agree(pair):
    _, g, _ = pair
    planes = np.ascontiguousarray(np.moveaxis(g, -1, 0))
    calm = np.full(g.shape[:2], 1e-4, np.float32)
    assert agreement(g, planes, calm, 10).min() > 0.99
    moved = planes.copy()
    moved[:, 40:80, 60:100] = 0.95 - moved[:, 40:80, 60:100]
    agreeing = agreement(g, moved, calm, 10)
    apart = np.abs(moved - planes).max(0)[50:70, 70:90] > 0.3
    assert agreeing[50:70, 70:90][apart].mean() < 0.1
    assert agreeing[120:].min() > 0.99


def test_less_is_tolerated_near_what_moved_and_more_in_noise(pair):
    _, g, _ = pair
    part, calm = np.s_[52:68, 74:90], np.full(g.shape[:2], 1e-4, np.float32)
    faint = np.moveaxis(g, -1, 0).copy()
    faint[:, 50:70, 70:92] += 0.07
    clear = faint.copy()
    clear[:, 45:75, 60:70] = 1
    alone = agreement(g, faint, calm, 10)[part].mean()
    beside = agreement(g, clear, calm, 10)[part].mean()
    assert alone > 0.9
    assert beside < 0.5
    assert agreement(g, clear, 1000 * calm, 10)[part].mean() > beside + 0.2
