from __future__ import annotations

from functools import partial

import cv2
import numpy as np
import pytest

from deshake.pair.denoising import denoised_tones, noisy_photo
from deshake.run import Run


def pair(lab, slope=0.004, floor=0.0006):
    sharp = lab.colours()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.002)
    frame = lab.frame(sharp)
    noise = np.random.default_rng(3).normal(size=frame.shape) * np.sqrt(slope * frame + floor)
    return frame, g, (frame + noise).astype(np.float32)


@pytest.mark.parametrize(("slope", "floor"), [(0.004, 0.0006), (0.0, 0.0025)])
def test_takes_most_of_the_noise_off(lab, slope, floor):
    frame, g, f_N = pair(lab, slope, floor)
    photo = lab.noisy_photo(g, f_N)
    denoised = np.moveaxis(photo.denoised, 0, -1)
    assert lab.psnr(denoised, frame) > lab.psnr(f_N, frame) + 4
    np.testing.assert_allclose(denoised.mean((0, 1)), frame.mean((0, 1)), rtol=0.01)
    np.testing.assert_array_equal(np.moveaxis(photo.pixels, 0, -1), f_N)
    assert photo.variance().mean() == pytest.approx(slope * frame.mean() + floor, rel=0.4)


def test_the_blurred_photo_fills_missing_pixels(lab):
    _, g, f_N = pair(lab)
    valid = np.ones(lab.shape, np.float32)
    valid[:30] = 0
    g[5, 6] = -0.01  # noise whose mean was taken back
    photo = lab.noisy_photo(g, f_N, valid)
    np.testing.assert_array_equal(np.moveaxis(photo.pixels, 0, -1)[:30], g[:30])
    assert photo.denoised.min() == 0
    assert np.isfinite(np.sqrt(photo.variance())).all()


def test_noise_is_taken_off_before_the_photo_is_resampled(lab):
    frame, g, f_N = pair(lab)
    ones = np.ones(lab.shape, np.float32)
    shift = np.float32([[1, 0, 0.5], [0, 1, 0.5]])

    def resampled(image):
        return cv2.warpAffine(image, shift, lab.shape[::-1], flags=cv2.INTER_CUBIC), ones

    before, valid = noisy_photo(g, f_N, resampled)
    assert valid is ones
    after = lab.noisy_photo(g, resampled(f_N)[0])
    truth, rim = np.moveaxis(resampled(frame)[0], -1, 0), np.s_[:, 4:-4, 4:-4]
    errors = [np.square(one.denoised - truth)[rim].mean() for one in (before, after)]
    assert errors[0] < 0.9 * errors[1]
    np.testing.assert_array_equal(before.pixels, np.moveaxis(resampled(f_N)[0], -1, 0))


def test_display_values_are_denoised_by_noise_of_their_own(lab):
    frame = np.moveaxis(lab.frame(lab.colours()), -1, 0)
    noise = np.random.default_rng(3).normal(size=frame.shape)
    sigmas = np.array([0.02, 0.04, 0.06])[:, None, None]
    noisy = (frame + sigmas * noise).astype(np.float32)
    denoised, estimated_sigmas = denoised_tones(noisy)
    np.testing.assert_allclose(estimated_sigmas, sigmas.ravel(), rtol=0.25)
    assert lab.psnr(denoised, frame) > lab.psnr(noisy, frame) + 3.5


def test_threads_do_not_change_a_byte(lab):
    _, g, f_N = pair(lab)
    ones = np.ones(lab.shape, np.float32)
    same = partial(noisy_photo, g, f_N, lambda image: (image, ones))
    results = {same(run=Run(n))[0].denoised.tobytes() for n in (1, 3)}
    assert len(results) == 1


@pytest.mark.parametrize("grey", [True, False])
def test_refuses_photos_that_are_no_pair(lab, grey):
    g = np.full((*lab.shape, 3), 0.5, np.float32)
    ones = np.ones(lab.shape, np.float32)
    wrong = g[..., 0] if grey else np.full_like(g, np.nan)
    with pytest.raises(ValueError, match="does not fit" if grey else "finite"):
        lab.noisy_photo(g, wrong, ones)
