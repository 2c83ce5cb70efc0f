from __future__ import annotations

import cv2
import numpy as np
import pytest

from deshake.geometry.kernel import RotationKernel
from deshake.operators.planes import channels_first
from deshake.operators.shake_blur import ShakeBlur, blur_filters
from deshake.restore.multiplicative_descent import MultiplicativeDescent
from deshake.restore.richardson_lucy import (
    latent_start,
    latent_start_by_mean,
    richardson_lucy,
    richardson_lucy_tv,
)
from deshake.run import Run

NAMES = ("uniform", "pan", "roll", "all")


@pytest.mark.parametrize("name", NAMES)
def test_recovers_a_scene(name, lab):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.kernels[name], sharp), 0.003)
    restored = richardson_lucy(g, lab.kernels[name])
    assert lab.psnr(restored.pixels, lab.frame(sharp)) > lab.psnr(g, lab.frame(sharp)) + 2
    assert restored.pixels.dtype == np.float32
    assert restored.pixels.min() >= 0
    assert 2 <= restored.iterations <= 40
    assert 0.5 * 0.003 < restored.residual < 3 * 0.003


@pytest.mark.parametrize("accelerated", [True, False])
@pytest.mark.parametrize(("sigma", "within"), [(0.0005, 1.0), (0.003, 1.0), (0.02, 0.3)])
def test_stops_near_the_best_iteration(sigma, within, accelerated, lab):
    sharp = lab.scene(8)
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), sigma)
    stopped = richardson_lucy(g, lab.all_axes, accelerated=accelerated)
    fastest = 0.75 if accelerated else 0.0
    going = MultiplicativeDescent(g, blur_filters(lab.all_axes), None, fastest=fastest, run=Run(1))
    gains = []
    for done in range(1, 31):
        going.step()
        gains.append(lab.psnr(going.frame(), lab.frame(sharp)))
        if done == stopped.iterations:
            np.testing.assert_allclose(stopped.pixels, going.frame(), atol=1e-5)
    assert lab.psnr(stopped.pixels, lab.frame(sharp)) > max(gains) - within


def test_more_noise_means_fewer_iterations(lab):
    blurred = lab.shaken(lab.all_axes, lab.scene())
    counts = [
        richardson_lucy(lab.noisy(blurred, s), lab.all_axes).iterations for s in (0.001, 0.01, 0.05)
    ]
    assert counts[0] > counts[1] > counts[2]


@pytest.mark.parametrize("name", ["uniform", "all"])
def test_plain_iterations_never_lower_the_likelihood(name, lab):
    kernel = lab.kernels[name]
    rng = np.random.default_rng(2)
    photons = 500
    g = (rng.poisson(lab.shaken(kernel, lab.scene()) * photons) / photons).astype(np.float32)
    # all of the scene that the frame saw is needed to blur it again: look where it is known
    r = 20
    height, width = lab.shape
    inner = kernel.camera.cropped(r, r, width - 2 * r, height - 2 * r)
    blur = ShakeBlur(kernel.for_camera(inner), margin=r)
    observed = g[r:-r, r:-r].astype(np.float64)
    going = MultiplicativeDescent(g, blur_filters(kernel), None, fastest=0, run=Run(1))
    likelihood = []
    for _ in range(14):
        going.step()
        model = blur.forward(going.frame()).astype(np.float64)
        likelihood.append(np.sum(observed * np.log(model) - model))
    assert np.all(np.diff(likelihood) > 0)


def test_acceleration_arrives_sooner(lab):
    g = lab.shaken(lab.all_axes, lab.scene())
    quick = richardson_lucy(g, lab.all_axes, iterations=10)
    slow = richardson_lucy(g, lab.all_axes, iterations=10, accelerated=False)
    slower = richardson_lucy(g, lab.all_axes, iterations=20, accelerated=False)
    assert quick.residual < slower.residual < slow.residual


def test_photos_without_clipping_get_the_plain_iteration(lab):
    g = lab.shaken(lab.all_axes, lab.scene())
    plain = richardson_lucy(g, lab.all_axes, iterations=4)
    none = richardson_lucy(g, lab.all_axes, iterations=4, clipped=np.zeros(g.shape, bool))
    np.testing.assert_array_equal(plain.pixels, none.pixels)


def test_one_plain_iteration_is_equation_11(lab):
    kernel = lab.kernels["pan"]
    g = lab.shaken(kernel, lab.scene())
    one = richardson_lucy(g, kernel, iterations=1, accelerated=False).pixels
    two = richardson_lucy(g, kernel, iterations=2, accelerated=False).pixels
    r = 20  # beyond the reach, twice: away from what the frame does not show
    blur = ShakeBlur(kernel, kind="warps", margin=0)
    ratio = g / np.maximum(blur.forward(one), 1e-6)
    ratio[:r], ratio[-r:], ratio[:, :r], ratio[:, -r:] = 1, 1, 1, 1
    expected = one * blur.adjoint(ratio) / np.maximum(blur.adjoint(np.ones_like(g)), 1e-6)
    inside = slice(2 * r, -2 * r), slice(2 * r, -2 * r)
    np.testing.assert_allclose(two[inside], expected[inside], atol=2e-3)
    assert np.abs(two - one)[inside].max() > 0.02


def test_a_white_photo_stays_white(lab):
    g = np.ones(lab.shape, np.float32)
    f = richardson_lucy(g, lab.all_axes, clipped=g > 0).pixels
    assert f.min() > 0.98
    assert np.isfinite(f).all()


def test_a_still_camera_changes_nothing(lab):
    g = np.ascontiguousarray(lab.frame(lab.scene()))
    f = richardson_lucy(g, RotationKernel.delta(lab.camera)).pixels
    np.testing.assert_allclose(f, g, atol=1e-5)


def test_the_kernel_need_not_be_centred(lab):
    g = lab.shaken(lab.all_axes, lab.scene())
    turned = lab.all_axes.shifted((4, -3, 2))
    f = richardson_lucy(g, lab.all_axes, iterations=6).pixels
    difference = richardson_lucy(g, turned, iterations=6).pixels - f
    # pixels are cut elsewhere by fractions; a picture shifted by four pixels would differ by .1
    assert np.sqrt(np.mean(np.square(difference))) < 0.02


@pytest.mark.parametrize("iterations", [None, 5])
def test_progress_is_reported(iterations, lab):
    reports = []
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.003)
    done = richardson_lucy(
        g,
        lab.all_axes,
        iterations=iterations,
        run=Run(progress=lambda part, text: reports.append((part, text))),
    )
    parts = [part for part, _ in reports]
    assert len(parts) == done.iterations
    assert all(0 < part <= 1 for part in parts)
    assert parts[-1] == 1
    assert parts.count(1) == 1
    assert reports[-1][1].endswith(str(done.iterations))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("sigma", [0.003, 0.02])
def test_total_variation_does_better(name, sigma, lab):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.kernels[name], sharp), sigma)
    plain, smooth = (m(g, lab.kernels[name]) for m in (richardson_lucy, richardson_lucy_tv))
    frame = lab.frame(sharp)
    assert lab.psnr(smooth.pixels, frame) > lab.psnr(plain.pixels, frame) + 0.3
    assert smooth.pixels.dtype == np.float32
    assert smooth.pixels.min() >= 0
    assert 2 <= smooth.iterations <= 30
    assert 0.5 * sigma < smooth.residual < 3 * sigma


def test_total_variation_needs_no_early_end(lab):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.02)
    ended, long = (richardson_lucy_tv(g, lab.all_axes, iterations=n).pixels for n in (None, 60))
    assert lab.psnr(long, lab.frame(sharp)) > lab.psnr(ended, lab.frame(sharp)) - 0.5
    wild = richardson_lucy(g, lab.all_axes, iterations=60).pixels
    assert lab.psnr(long, lab.frame(sharp)) > lab.psnr(wild, lab.frame(sharp)) + 3


def test_total_variation_ends_at_the_noise_of_smooth_photos(lab):
    sharp = cv2.GaussianBlur(lab.scene(), (0, 0), 8)
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.005)
    ended = richardson_lucy_tv(g, lab.all_axes)
    more = richardson_lucy_tv(g, lab.all_axes, iterations=4)  # where it would stall
    assert ended.iterations < 4
    frame = lab.frame(sharp)
    assert lab.psnr(ended.pixels, frame) > lab.psnr(more.pixels, frame) + 0.5


def test_total_variation_leaves_clipped_lamps_bright(lab):
    sharp, g, clipped, around = lab.lamps()
    f = richardson_lucy_tv(g, lab.all_axes, clipped=clipped).pixels
    plain = richardson_lucy(g, lab.all_axes, clipped=clipped).pixels
    assert f.max() > 3
    light = lab.frame(sharp) > 4
    assert f[light].sum() > 0.9 * plain[light].sum()
    errors = [np.mean(np.square(x - lab.frame(sharp))[around]) for x in (f, plain)]
    assert errors[0] < errors[1]


def started(g, kernel, iterations, coloured, run=Run(1)):
    """Return the first estimate for another method, and the blur."""
    blur = blur_filters(kernel, channels=len(channels_first(g)))
    f = latent_start_by_mean(
        g, blur, clipped=None, iterations=iterations, coloured=coloured, run=run
    )
    return f, blur


def test_a_first_estimate_takes_its_detail_from_the_mean_of_the_colours(lab):
    grey = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.003)
    shares = np.array([1, 0.5, 0.2], np.float32)
    f, _ = started(grey[..., None] * shares, lab.all_axes, 6, 0)
    one, _ = started(grey, lab.all_axes, 6, 0)
    assert f.shape == (3, *one.shape[1:])
    np.testing.assert_allclose(f, shares[:, None, None] * one, rtol=2e-3, atol=2e-4)


@pytest.mark.parametrize("coloured", [0, 1, 2])
def test_a_first_estimate_explains_colours_better_with_every_iteration(coloured, lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.colours()), 0.003)

    def misfit(count):
        f, blur = started(g, lab.all_axes, 6, count)
        return float(np.square(blur.forward(f) - channels_first(g)).mean())

    assert misfit(coloured + 1) < 0.95 * misfit(coloured)


def test_a_first_estimate_recovers_what_the_mean_of_the_colours_does_not_show(lab):
    sharp = lab.colours()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.003)
    alone = np.concatenate([started(g[..., c], lab.all_axes, 10, 0)[0] for c in range(3)])
    m = (alone.shape[1] - len(g)) // 2

    def quality(latent):
        return lab.psnr(latent[:, m:-m, m:-m].transpose(1, 2, 0), lab.frame(sharp))

    lost, left = (quality(alone) - quality(started(g, lab.all_axes, 6, n)[0]) for n in (0, 4))
    assert lost > 3
    assert left < 0.5 * lost


def test_a_first_estimate_reports_all_its_iterations(lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.colours()), 0.003)
    shares = []
    started(g, lab.all_axes, 3, 2, run=Run(1, lambda share, _: shares.append(share)))
    assert shares == pytest.approx([0.2, 0.4, 0.6, 0.8, 1])
    shares.clear()
    started(
        np.repeat(g[..., :1], 3, 2),
        lab.all_axes,
        3,
        4,
        run=Run(1, lambda share, _: shares.append(share)),
    )
    assert shares == pytest.approx([1 / 7, 2 / 7, 3 / 7, 4 / 7, 1])  # no colour, no more iterations
    shares.clear()
    started(g[..., 0], lab.all_axes, 4, 2, run=Run(1, lambda share, _: shares.append(share)))
    assert shares == pytest.approx([0.25, 0.5, 0.75, 1])


def test_a_first_estimate_goes_on_from_another_one_and_leaves_it_unchanged(lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.003)
    blur = blur_filters(lab.all_axes)

    def begun(iterations, f=None):
        return latent_start(g, blur, clipped=None, iterations=iterations, f=f, run=Run(1))

    def misfit(f):
        return float(np.square(blur.forward(f)[0] - g).mean())

    six = begun(6)
    before = six.copy()
    assert np.array_equal(begun(0, six), before)
    assert misfit(begun(3, six)) < 0.8 * min(misfit(six), misfit(begun(3)))
    assert np.array_equal(six, before)
