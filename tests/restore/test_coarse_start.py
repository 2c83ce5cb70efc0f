"""The first estimate from the photo at half its size."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.operators.planes import channels_first
from deshake.operators.shake_blur import blur_filters
from deshake.restore.coarse_start import Iterations, coarse_start
from deshake.restore.richardson_lucy import latent_start
from deshake.run import Run


def started(g, kernel, fine, clipped=None, run=Run(1)):
    """Return the first estimate, the blur, and its margin."""
    kernel = kernel.centred()
    margin = kernel.reach_px()
    blur = blur_filters(kernel, margin=margin, channels=len(channels_first(g)))
    f = coarse_start(
        g,
        kernel,
        blur,
        margin=margin,
        clipped=clipped,
        iterations=Iterations(12, 3, fine),
        run=run,
    )
    return f, blur, margin


def within(f, margin):
    return np.ascontiguousarray(f[:, margin:-margin, margin:-margin])


def moved(one, other):
    """Return by how many pixels, across and down, one picture lies before another."""
    one, other = (cv2.GaussianBlur(f, (0, 0), 2)[12:-12, 12:-12] for f in (one, other))
    down, across = np.gradient((one + other) / 2)
    slopes = np.stack([across.ravel(), down.ravel()], 1)
    return np.linalg.lstsq(slopes, (one - other).ravel(), rcond=None)[0]


@pytest.mark.parametrize("cut", [(0, 0), (1, 0), (0, 1), (1, 1)])
@pytest.mark.parametrize("name", ["uniform", "all"])
def test_it_lies_where_the_estimate_at_the_full_size_lies(name, cut, lab):
    rows, columns = (side - less for side, less in zip(lab.camera.shape, cut, strict=True))
    g = lab.noisy(lab.shaken(lab.kernels[name], lab.scene()), 0.003)[:rows, :columns]
    kernel = lab.kernels[name].for_camera(lab.camera.cropped(0, 0, columns, rows))
    f, blur, margin = started(g, kernel, 0)
    full = latent_start(g, blur, clipped=None, iterations=12, run=Run(1))
    assert f.shape == full.shape
    assert f.dtype == np.float32
    assert np.abs(moved(within(full, margin)[0], within(f, margin)[0])).max() < 0.02
    shifted = np.roll(within(f, margin)[0], 1, axis=1)
    assert moved(shifted, within(f, margin)[0])[0] == pytest.approx(-1, abs=0.1)


def test_iterations_at_the_full_size_add_detail(lab):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.003)

    def misfit_and_quality(fine):
        f, blur, margin = started(g, lab.all_axes, fine)
        misfit = float(np.square(blur.forward(f)[0] - g).mean())
        return misfit, lab.psnr(within(f, margin)[0], lab.frame(sharp))

    (none, coarse), (two, better), (five, best) = map(misfit_and_quality, (0, 2, 5))
    assert five < two < 0.8 * none
    assert best > better > coarse


def test_noise_stays_weaker_than_at_the_full_size(lab):
    flat = np.full(lab.camera.shape, 0.4, np.float32)
    g = lab.noisy(flat, 0.02)
    f, blur, margin = started(g, lab.all_axes, 2)
    full = latent_start(g, blur, clipped=None, iterations=12, run=Run(1))
    assert within(f, margin).std() < 0.7 * within(full, margin).std()


def test_its_detail_holds_for_every_colour(lab):
    grey = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.003)
    shares = np.array([1, 0.5, 0.2], np.float32)
    f, _, _ = started(grey[..., None] * shares, lab.all_axes, 4)
    one, _, _ = started(grey, lab.all_axes, 4)
    np.testing.assert_allclose(f, shares[:, None, None] * one, rtol=2e-2, atol=2e-3)


def test_clipped_lamps_become_brighter_than_the_clip_level(lab):
    sharp, g, clipped, _ = lab.lamps()
    f, _, margin = started(g, lab.all_axes, 4, clipped)
    cut, _, _ = started(g, lab.all_axes, 4)
    f, cut = within(f, margin), within(cut, margin)
    light = lab.frame(sharp) > 4
    assert f.max() > 3
    assert f[:, light].sum() > 1.5 * cut[:, light].sum()


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (2, 3), (5, 4, 3)])
def test_tiny_photos_have_one_too(shape):
    g = np.full(shape, 0.5, np.float32)
    camera = Camera.from_focal(20.0, *shape[:2])
    theta = np.array([[0, -0.05, 0], [0, 0.05, 0]])
    kernel = RotationKernel(theta, np.full(2, 0.5), np.full(3, 0.05), camera)
    f, _, margin = started(g, kernel, 2)
    np.testing.assert_allclose(within(f, margin), 0.5, rtol=1e-3)


def test_it_reports_its_progress(lab):
    g = lab.shaken(lab.all_axes, lab.scene())
    shares = []
    started(g, lab.all_axes, 3, run=Run(1, lambda share, _: shares.append(share)))
    assert shares == sorted(shares)
    assert shares[0] < 0.3
    assert shares[-1] == 1
