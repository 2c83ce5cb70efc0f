from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.pair.denoising import noisy_photo
from deshake.pair.fusion import fuse
from deshake.pair.residual import residual_richardson_lucy
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run


@pytest.fixture(scope="module")
def pair(lab):
    """Make the sharp frame, the blurred photo and a noisy one that misses a side."""

    def make(sigma, name="all"):
        sharp = lab.colours()
        g = lab.noisy(lab.shaken(lab.kernels[name], sharp), 0.003)
        frame = np.ascontiguousarray(lab.frame(sharp))
        noise = np.random.default_rng(3).normal(0, sigma, frame.shape)
        valid = np.ones(lab.shape, np.float32)
        valid[:, :8] = 0
        return frame, g, (frame + noise).astype(np.float32), valid

    return make


def fused_with(g, f_N, valid, kernel, **options):
    """Fuse a photo with a noisy one that lies in its frame."""
    noisy, valid = noisy_photo(g, f_N, lambda image: (image, valid))
    return fuse(g, noisy, kernel, valid=valid, **options)


@pytest.mark.parametrize("name", ["uniform", "all"])
@pytest.mark.parametrize("sigma", [0.02, 0.1])
def test_better_than_either_photo_alone_and_than_residuals(name, sigma, lab, pair):
    frame, g, f_N, valid = pair(sigma, name)
    kernel = lab.kernels[name]
    fused = fused_with(g, f_N, valid, kernel)
    noisy = lab.noisy_photo(g, f_N, valid)
    f_D = np.moveaxis(noisy.denoised, 0, -1)
    quality = lab.psnr(fused.pixels, frame)
    assert quality > lab.psnr(f_D, frame) + 0.5
    single = lab.psnr(sparse_gradients(g, kernel).pixels, frame)
    assert quality > single + (1 if sigma < 0.05 else 0)
    assert quality > lab.psnr(residual_richardson_lucy(g, noisy, kernel).pixels, frame) + 1
    assert fused.pixels.min() >= 0
    assert fused.pixels.dtype == np.float32


def test_a_wrong_kernel_is_not_believed(lab, pair):
    frame, g, f_N, valid = pair(0.03)
    fused = fused_with(g, f_N, valid, RotationKernel.delta(lab.camera))
    f_D = np.moveaxis(lab.noisy_photo(g, f_N, valid).denoised, 0, -1)
    inside = np.s_[:, 12:]
    assert lab.psnr(fused.pixels[inside], frame[inside]) > lab.psnr(f_D[inside], frame[inside]) - 1
    assert lab.psnr(fused.pixels[inside], frame[inside]) > lab.psnr(g[inside], frame[inside]) + 2


def test_what_moved_between_the_photos_is_as_in_the_noisy_one(lab, pair):
    frame, g, f_N, valid = pair(0.03)
    moved, then = f_N.copy(), frame.copy()
    moved[40:90, 60:120] += 0.9 - frame[40:90, 60:120]
    then[40:90, 60:120] = 0.9
    f = fused_with(g, moved, valid, lab.all_axes).pixels
    f_D = np.moveaxis(lab.noisy_photo(g, moved, valid).denoised, 0, -1)
    around = np.s_[20:110, 40:140]
    assert lab.psnr(f[around], then[around]) > lab.psnr(f_D[around], then[around])
    worse = np.square(f - then).mean(-1) - np.square(f_D - then).mean(-1)
    assert cv2.GaussianBlur(worse, (0, 0), 4)[around].max() < 0.03**2


def test_the_noisy_photo_shows_the_scene_beyond_the_border(lab):
    sharp = lab.colours()
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


def test_where_the_noisy_photo_clipped_it_is_not_gone_by(lab, pair):
    frame, g, f_N, valid = pair(0.02)
    clipped = frame.max(-1) > 0.55
    low = np.where(clipped[..., None], np.minimum(f_N, 0.5), f_N)
    with_mask, without_mask = (
        fused_with(g, low, valid, lab.all_axes, noisy_clipped=mask).pixels
        for mask in (clipped, None)
    )
    assert lab.psnr(with_mask[clipped], frame[clipped]) > lab.psnr(
        without_mask[clipped], frame[clipped]
    )


def test_constant_photos_stay_constant(lab):
    for level in (0.0, 0.25, 1.0):
        g = np.full((*lab.shape, 3), level, np.float32)
        f = fused_with(g, g, np.ones(lab.shape, np.float32), lab.all_axes).pixels
        np.testing.assert_allclose(f, level, atol=0.01)


def test_grey_photos_pass_and_colours_keep_their_brightness(lab, pair):
    _, g, f_N, valid = pair(0.05)
    grey = fused_with(g[..., 0], f_N[..., 0], valid, lab.all_axes).pixels
    assert grey.shape == lab.shape
    colour = fused_with(g, f_N, valid, lab.all_axes).pixels
    np.testing.assert_allclose(colour.mean((0, 1)), g.mean((0, 1)), rtol=0.01)


def test_the_smallest_photos_pass():
    for shape in ((1, 1), (1, 40), (7, 5)):
        g = np.full(shape, 0.5, np.float32)
        kernel = RotationKernel.delta(Camera.from_focal(50, *shape))
        f = fused_with(g, g, np.ones(shape, np.float32), kernel).pixels
        np.testing.assert_allclose(f, g, atol=1e-2)


def test_threads_do_not_change_a_byte(lab, pair):
    _, g, f_N, valid = pair(0.05)
    results = {
        fused_with(g, f_N, valid, lab.all_axes, run=Run(n), iterations=2).pixels.tobytes()
        for n in (1, 4)
    }
    assert len(results) == 1


def test_the_photos_are_left_alone(lab, pair):
    _, g, f_N, valid = pair(0.05)
    kept = [image.copy() for image in (g, f_N, valid)]
    for image in (g, f_N, valid):
        image.setflags(write=False)
    fused_with(g, f_N, valid, lab.all_axes, iterations=1)
    for image, before in zip((g, f_N, valid), kept, strict=True):
        np.testing.assert_array_equal(image, before)


def test_progress_is_reported(lab, pair):
    _, g, f_N, valid = pair(0.05)
    reports = []
    fused_with(
        g,
        f_N,
        valid,
        lab.all_axes,
        run=Run(progress=lambda part, text: reports.append((part, text))),
    )
    parts = [part for part, _ in reports]
    assert parts == sorted(parts)
    assert parts.count(1) == 1
    assert reports[-1] == (1, "deblurring, stage 10")


def test_refuses_what_does_not_fit(lab, pair):
    _, g, f_N, valid = pair(0.05)
    noisy = lab.noisy_photo(g, f_N, valid)
    grey = lab.noisy_photo(g[..., 0], f_N[..., 0], valid)
    wrong = ((g, grey, valid), (g, noisy, valid[1:]), (g[1:], noisy, valid))
    for blurred, other, valid_pixels in wrong:
        with pytest.raises(ValueError, match="does not fit"):
            fuse(blurred, other, lab.all_axes, valid=valid_pixels)
