from __future__ import annotations

from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.pair.denoising import NoisyPhoto, noisy_photo
from deshake.pair.fusion import fuse
from deshake.pair.residual import residual_richardson_lucy
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run

pytestmark = pytest.mark.long


class Case(NamedTuple):
    """A sharp frame, the blurred photo, a short exposure that misses a side, the same denoised."""

    frame: np.ndarray
    g: np.ndarray
    short: np.ndarray
    valid: np.ndarray
    noisy: NoisyPhoto


@pytest.fixture(scope="module")
def pair(lab):
    """Make the pair of a strength of noise and a kernel, once."""

    @cache
    def make(sigma, name="all"):
        sharp = lab.colours()
        g = lab.noisy(lab.shaken(lab.kernels[name], sharp), 0.003)
        frame = np.ascontiguousarray(lab.frame(sharp))
        noise = np.random.default_rng(3).normal(0, sigma, frame.shape)
        f_N = (frame + noise).astype(np.float32)
        valid = np.ones(lab.shape, np.float32)
        valid[:, :8] = 0
        return Case(frame, g, f_N, valid, lab.noisy_photo(g, f_N, valid))

    return make


def image_of(noisy):
    """Return the denoised photo as an image."""
    return np.moveaxis(noisy.denoised, 0, -1)


def fused(case, kernel, **options):
    return fuse(case.g, case.noisy, kernel, valid=case.valid, **options)


def fused_with(g, f_N, valid, kernel, **options):
    """Fuse a photo with a noisy one that lies in its frame."""
    noisy, valid = noisy_photo(g, f_N, lambda image: (image, valid))
    return fuse(g, noisy, kernel, valid=valid, **options)


@pytest.mark.parametrize(("name", "sigma"), [("uniform", 0.02), ("all", 0.02), ("all", 0.1)])
def test_better_than_either_photo_alone_and_than_residuals(name, sigma, lab, pair):
    case = pair(sigma, name)
    kernel = lab.kernels[name]
    result = fused(case, kernel)
    quality = lab.psnr(result.pixels, case.frame)
    assert quality > lab.psnr(image_of(case.noisy), case.frame) + 0.5
    single = lab.psnr(sparse_gradients(case.g, kernel).pixels, case.frame)
    assert quality > single + (1 if sigma < 0.05 else 0)
    residual = residual_richardson_lucy(case.g, case.noisy, kernel).pixels
    assert quality > lab.psnr(residual, case.frame) + 1
    assert result.pixels.min() >= 0
    assert result.pixels.dtype == np.float32


def test_a_wrong_kernel_is_not_trusted(lab, pair):
    case = pair(0.02)
    frame, f, f_D = case.frame, fused(case, RotationKernel.delta(lab.camera)).pixels, case.noisy
    inside = np.s_[:, 12:]
    quality = lab.psnr(f[inside], frame[inside])
    assert quality > lab.psnr(image_of(f_D)[inside], frame[inside]) - 1
    assert quality > lab.psnr(case.g[inside], frame[inside]) + 2


def test_what_moved_between_the_photos_is_as_in_the_noisy_one(lab, pair):
    frame, g, f_N, valid, _ = pair(0.02)
    moved, then = f_N.copy(), frame.copy()
    moved[40:90, 60:120] += 0.9 - frame[40:90, 60:120]
    then[40:90, 60:120] = 0.9
    noisy = lab.noisy_photo(g, moved, valid)
    f, f_D = fuse(g, noisy, lab.all_axes, valid=valid).pixels, image_of(noisy)
    around = np.s_[20:110, 40:140]
    assert lab.psnr(f[around], then[around]) > lab.psnr(f_D[around], then[around])
    worse = np.square(f - then).mean(-1) - np.square(f_D - then).mean(-1)
    assert cv2.GaussianBlur(worse, (0, 0), 4)[around].max() < 0.03**2


def test_the_noisy_photo_shows_the_scene_beyond_the_border(lab):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.003)
    noise = np.random.default_rng(3).normal(0, 0.02, sharp.shape)
    f_N = (sharp + noise).astype(np.float32)
    valid = np.ones(f_N.shape[:2], np.float32)
    valid[:, : (len(sharp) - lab.shape[0]) // 2 + 6] = 0
    frame = np.ascontiguousarray(lab.frame(sharp))
    further = fuse(g, lab.noisy_photo(g, f_N, valid), lab.all_axes, valid=valid).pixels
    within = fused_with(g, lab.frame(f_N), lab.frame(valid), lab.all_axes).pixels
    rim = np.ones(lab.shape, bool)
    rim[8:-8, :-8] = rim[:, :16] = False
    assert lab.psnr(further[rim], frame[rim]) > lab.psnr(within[rim], frame[rim]) + 0.2


def test_clipped_pixels_of_the_noisy_photo_are_not_used(lab, pair):
    frame, g, f_N, valid, _ = pair(0.02)
    frame, g, f_N = (np.ascontiguousarray(picture[..., 0]) for picture in (frame, g, f_N))
    clipped = frame > 0.55
    low = np.where(clipped, np.minimum(f_N, 0.5), f_N)
    with_mask, without_mask = (
        fused_with(g, low, valid, lab.all_axes, noisy_clipped=mask).pixels
        for mask in (clipped, None)
    )
    assert lab.psnr(with_mask[clipped], frame[clipped]) > lab.psnr(
        without_mask[clipped], frame[clipped]
    )


@pytest.mark.parametrize("level", [0.0, 0.25, 1.0])
def test_constant_photos_stay_constant(level):
    shape = (30, 40)
    g = np.full((*shape, 3), level, np.float32)
    camera = Camera.from_focal(50.0, *shape)
    kernel = RotationKernel.from_path([(0, -0.03, -0.02), (0.02, 0.03, 0.02)], camera)
    f = fused_with(g, g, np.ones(shape, np.float32), kernel).pixels
    np.testing.assert_allclose(f, level, atol=0.01)


def test_colours_keep_their_brightness_and_progress_is_reported(lab, pair):
    case = pair(0.1)
    reports = []
    colour = fused(
        case, lab.all_axes, run=Run(progress=lambda part, text: reports.append((part, text)))
    ).pixels
    np.testing.assert_allclose(colour.mean((0, 1)), case.g.mean((0, 1)), rtol=0.01)
    parts = [part for part, _ in reports]
    assert parts == sorted(parts)
    assert parts.count(1) == 1
    assert reports[-1] == (1, "deblurring, stage 10")


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (7, 5)])
def test_the_smallest_photos_pass(shape):
    g = np.full(shape, 0.5, np.float32)
    kernel = RotationKernel.delta(Camera.from_focal(50, *shape))
    f = fused_with(g, g, np.ones(shape, np.float32), kernel).pixels
    np.testing.assert_allclose(f, g, atol=1e-2)


def test_threads_change_no_byte_and_the_photos_are_left_alone(lab, pair):
    case = pair(0.02)
    arrays = case.g, case.valid, case.noisy.pixels, case.noisy.denoised
    kept = [image.copy() for image in arrays]
    results = {fused(case, lab.all_axes, run=Run(n), iterations=1).pixels.tobytes() for n in (1, 4)}
    assert len(results) == 1
    for image, before in zip(arrays, kept, strict=True):
        np.testing.assert_array_equal(image, before)


def test_grey_photos_pass_and_what_does_not_fit_is_refused(lab, pair):
    _, g, f_N, valid, noisy = pair(0.02)
    grey = lab.noisy_photo(g[..., 0], f_N[..., 0], valid)
    once = fuse(np.ascontiguousarray(g[..., 0]), grey, lab.all_axes, valid=valid, iterations=1)
    assert once.pixels.shape == lab.shape
    wrong = ((g, grey, valid), (g, noisy, valid[1:]), (g[1:], noisy, valid))
    for blurred, other, valid_pixels in wrong:
        with pytest.raises(ValueError, match="does not fit"):
            fuse(blurred, other, lab.all_axes, valid=valid_pixels)
