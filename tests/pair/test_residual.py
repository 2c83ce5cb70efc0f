from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from deshake.operators.filter_flow import reach
from deshake.operators.shake_blur import ShakeBlur
from deshake.pair.denoising import NoisyPhoto
from deshake.pair.residual import gain_map, joint_bilateral, residual_richardson_lucy
from deshake.run import Run

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def pair(lab):
    """The sharp frame, the blurred photo, and the denoised one."""
    sharp = lab.colours()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.002)
    frame = np.ascontiguousarray(lab.frame(sharp))
    f_N = frame + np.random.default_rng(3).normal(0, 0.08, frame.shape).astype(np.float32)
    noisy = lab.noisy_photo(g, f_N)
    return frame, g, noisy


@pytest.fixture(scope="module")
def restored(lab, pair):
    """What the method makes of the pair by default."""
    _, g, noisy = pair
    return residual_richardson_lucy(g, noisy, lab.all_axes)


def image_of(noisy):
    """Return the denoised photo as an image."""
    return np.ascontiguousarray(np.moveaxis(noisy.denoised, 0, -1))


def grey(noisy):
    """Take the first colour of a noisy photo."""
    return replace(noisy, pixels=noisy.pixels[:1], denoised=noisy.denoised[:1])


def test_improves_on_the_denoised_photo(lab, pair, restored):
    frame, g, noisy = pair
    plain = residual_richardson_lucy(g, noisy, lab.all_axes, gain=False)
    for result in (plain, restored):
        assert lab.psnr(result.pixels, frame) > lab.psnr(image_of(noisy), frame) + 1
        assert result.pixels.min() >= 0
        assert 1 <= result.iterations <= 20


@pytest.mark.parametrize("sigma", [0.005, 0.05])
def test_stops_by_the_noise_near_the_best_iteration(sigma, lab):
    sharp = lab.scene()
    frame = np.ascontiguousarray(lab.frame(sharp))
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), sigma)
    f_N = frame + np.random.default_rng(3).normal(0, 0.08, frame.shape).astype(np.float32)
    noisy = lab.noisy_photo(g, f_N)
    stopped = residual_richardson_lucy(g, noisy, lab.all_axes)
    gains = [
        lab.psnr(residual_richardson_lucy(g, noisy, lab.all_axes, iterations=n).pixels, frame)
        for n in (1, 3, 7, 14)
    ]
    assert lab.psnr(stopped.pixels, frame) > max(gains) - 0.5


def test_more_noise_means_fewer_iterations_and_iterations_override(lab, pair, restored):
    _, g, noisy = pair
    noise = np.random.default_rng(4).normal(0, 0.04, g.shape).astype(np.float32)
    loud = residual_richardson_lucy(g + noise, noisy, lab.all_axes)
    assert restored.iterations > loud.iterations
    other = restored.iterations - 1
    assert residual_richardson_lucy(g, noisy, lab.all_axes, iterations=other).iterations == other


def test_what_moved_is_left_as_the_denoised_photo_has_it(lab, pair):
    _, g, noisy = pair
    moved = g.copy()
    moved[40:90, 60:120] = 0.95
    result = residual_richardson_lucy(moved, noisy, lab.all_axes).pixels
    part = np.s_[55:75, 80:100]
    assert np.abs(result - image_of(noisy))[part].mean() < 0.03


def test_what_is_explained_already_stays(lab, pair):
    frame, _, _ = pair
    margin = reach(lab.camera, lab.all_axes.theta)
    around = np.pad(frame, ((margin, margin), (margin, margin), (0, 0)), mode="edge")
    g = ShakeBlur(lab.all_axes).forward(around)
    planes = np.moveaxis(frame, -1, 0)
    noisy = NoisyPhoto(planes, planes, 0.0, 1e-4)
    result = residual_richardson_lucy(g, noisy, lab.all_axes, gain=False, iterations=5)
    np.testing.assert_allclose(result.pixels, frame, atol=1e-4)
    assert result.residual < 1e-4


def test_every_iteration_explains_more(lab, pair):
    _, g, noisy = pair
    one, start = g[..., 0], grey(noisy)

    def divergence(iterations):
        result = residual_richardson_lucy(
            one, start, lab.all_axes, gain=False, iterations=iterations
        )
        return result.residual

    falls = [divergence(n) for n in (1, 2, 4, 8)]
    assert all(a > b for a, b in pairwise(falls))


def test_the_gain_map_follows_the_edges():
    image = np.full((96, 128), 0.2, np.float32)
    image[:, 64:] = 0.8
    gains = gain_map(image)
    assert gains.shape == image.shape
    assert gains[:, 62:66].mean() > gains[:, :16].mean() + 0.01
    np.testing.assert_allclose(gain_map(np.full((96, 128), 0.5, np.float32)), 0.8, atol=1e-6)


def test_the_gain_map_calms_even_parts(lab, pair):
    _, g, noisy = pair
    f_D = image_of(noisy)
    calm, full = (
        residual_richardson_lucy(g, noisy, lab.all_axes, gain=gain, detail=False)
        for gain in (True, False)
    )
    assert np.abs(calm.pixels - f_D).mean() < np.abs(full.pixels - f_D).mean()


def test_bilateral_means_keep_the_guides_edges():
    rng = np.random.default_rng(1)
    guide = np.zeros((60, 60), np.float32)
    guide[:, 30:] = 1
    image = guide + rng.normal(0, 0.1, guide.shape).astype(np.float32)
    averaged = joint_bilateral(image, guide)
    assert averaged[:, 28:30].mean() < 0.05
    assert averaged[:, 30:32].mean() > 0.95
    assert averaged[:, :28].std() < 0.4 * image[:, :28].std()
    np.testing.assert_allclose(joint_bilateral(guide, guide), guide, atol=1e-6)


def test_bands_do_not_show(monkeypatch):
    image = np.random.default_rng(2).random((70, 40), np.float32)
    whole = joint_bilateral(image, image)
    monkeypatch.setattr("deshake.pair.residual._BAND", 16)
    np.testing.assert_allclose(joint_bilateral(image, image), whole, atol=1e-6)


def test_progress_is_reported(lab, pair):
    _, g, noisy = pair
    shares = []
    residual_richardson_lucy(
        g, noisy, lab.all_axes, iterations=2, run=Run(progress=lambda part, _: shares.append(part))
    )
    assert shares == sorted(shares)
    assert len(shares) == 12
    assert shares[-1] == 1


def test_refuses_what_does_not_fit(lab, pair):
    _, g, noisy = pair
    with pytest.raises(ValueError, match="does not fit"):
        residual_richardson_lucy(g, grey(noisy), lab.all_axes)
    with pytest.raises(ValueError, match="at least one"):
        residual_richardson_lucy(g, noisy, lab.all_axes, iterations=0)
