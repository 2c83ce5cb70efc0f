from __future__ import annotations

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.restore.richardson_lucy import richardson_lucy
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run

NAMES = ("uniform", "pan", "roll", "all")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("sigma", [0.003, 0.02])
def test_recovers_a_scene_better_than_richardson_lucy(name, sigma, lab):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.kernels[name], sharp), sigma)
    restored = sparse_gradients(g, lab.kernels[name])
    other = richardson_lucy(g, lab.kernels[name])
    assert (
        lab.psnr(restored.pixels, lab.frame(sharp)) > lab.psnr(other.pixels, lab.frame(sharp)) + 0.5
    )
    assert lab.psnr(restored.pixels, lab.frame(sharp)) > lab.psnr(g, lab.frame(sharp)) + 2
    assert restored.pixels.dtype == np.float32
    assert restored.pixels.min() >= 0
    assert 0.5 * sigma < restored.residual < 3 * sigma


def test_keeps_its_head_with_a_wrong_kernel(lab):
    rng = np.random.default_rng(3)
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.01)
    weights = lab.all_axes.weights * np.exp(rng.normal(0, 0.5, len(lab.all_axes.weights)))
    wrong = RotationKernel(
        lab.all_axes.theta, weights / weights.sum(), lab.all_axes.steps, lab.camera
    ).above(0.2)
    f = sparse_gradients(g, wrong).pixels
    assert lab.psnr(f, lab.frame(sharp)) > lab.psnr(g, lab.frame(sharp)) + 1


@pytest.mark.parametrize("name", NAMES)
def test_keeps_the_brightness_of_every_colour(name, lab):
    sharp = lab.colours() * np.array([1, 0.5, 0.2], np.float32)
    g = lab.noisy(lab.shaken(lab.kernels[name], sharp), 0.003)
    f = sparse_gradients(g, lab.kernels[name]).pixels
    before, after = (x.mean((0, 1), dtype=float) for x in (g, f))
    np.testing.assert_allclose(after, before, rtol=2e-3)


def test_the_border_is_nearly_as_good_as_the_middle(lab):
    sharp = lab.scene(3)
    f = sparse_gradients(lab.noisy(lab.shaken(lab.all_axes, sharp), 0.003), lab.all_axes).pixels
    error = np.square(f - lab.frame(sharp))
    middle = np.zeros(error.shape, bool)
    middle[16:-16, 16:-16] = True
    behind = 10 * np.log10(error[~middle].mean() / error[middle].mean())
    assert behind < 3.5


def test_clipped_lamps_do_not_ring(lab):
    sharp, g, clipped, around = lab.lamps()
    errors = {}
    for name, mask in (("masked", clipped), ("unmasked", None)):
        f = sparse_gradients(g, lab.all_axes, clipped=mask).pixels
        errors[name] = np.mean(np.square(np.minimum(f, 1) - lab.frame(sharp))[around])
        if name == "masked":
            assert f.max() > 3  # lamps shine again
    assert errors["masked"] < 0.8 * errors["unmasked"]


@pytest.mark.parametrize("level", [0.0, 0.25, 1.0])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_constant_photo_stays_constant(level, channels, lab):
    g = np.full((*lab.shape, *channels), level, np.float32)
    clipped = np.full(lab.shape, level == 1)
    f = sparse_gradients(g, lab.all_axes, clipped=clipped).pixels
    assert f.shape == g.shape
    np.testing.assert_allclose(np.minimum(f, 1), level, atol=0.01)


def test_a_still_camera_changes_little(lab):
    g = np.ascontiguousarray(lab.frame(lab.scene()))
    f = sparse_gradients(g, RotationKernel.delta(lab.camera)).pixels
    assert lab.psnr(f, g) > 40


def test_the_smallest_photos_pass():
    for shape in ((1, 1), (1, 40), (7, 5)):
        g = np.full(shape, 0.5, np.float32)
        kernel = RotationKernel.delta(Camera.from_focal(50, *shape))
        np.testing.assert_allclose(sparse_gradients(g, kernel).pixels, g, atol=1e-3)


def test_grey_photos_stay_grey(lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.003)
    colour = sparse_gradients(np.stack([g, g, g], -1), lab.all_axes).pixels
    np.testing.assert_allclose(colour, colour[..., :1].repeat(3, -1), atol=1e-5)


@pytest.mark.parametrize("sigma", [0.003, 0.02])
def test_more_stages_do_better(sigma, lab):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), sigma)
    one, seven = (sparse_gradients(g, lab.all_axes, iterations=n) for n in (1, 7))
    assert (one.iterations, seven.iterations) == (1, 7)
    frame = lab.frame(sharp)
    assert lab.psnr(seven.pixels, frame) > lab.psnr(one.pixels, frame) + 0.5


def test_threads_do_not_change_a_byte(lab):
    sharp = lab.colours()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.003)
    one, four = (
        sparse_gradients(g, lab.all_axes, clipped=g[..., 0] > 0.7, run=Run(t)) for t in (1, 4)
    )
    assert one.pixels.tobytes() == four.pixels.tobytes()


def test_bands_do_not_show(monkeypatch, lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.003)
    module = "deshake.signal.half_quadratic"
    whole = sparse_gradients(g, lab.all_axes).pixels
    monkeypatch.setattr(f"{module}._BAND_PIXELS", 1)
    np.testing.assert_allclose(sparse_gradients(g, lab.all_axes).pixels, whole, atol=1e-4)


def test_the_photo_is_left_alone(lab):
    g = lab.shaken(lab.all_axes, lab.scene())
    before = g.copy()
    g.setflags(write=False)
    sparse_gradients(g, lab.all_axes, iterations=1)
    np.testing.assert_array_equal(g, before)


def test_progress_is_reported(lab):
    reports = []
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.003)
    sparse_gradients(
        g, lab.all_axes, run=Run(progress=lambda part, text: reports.append((part, text)))
    )
    parts = [part for part, _ in reports]
    assert parts == sorted(parts)
    assert 0 < parts[0] < 0.2
    assert parts[-1] == 1
    assert parts.count(1) == 1
    assert reports[-1][1] == "deblurring, stage 5"


def test_refuses_what_does_not_fit(lab):
    g = np.full(lab.shape, 0.5, np.float32)
    broken = g.copy()
    broken[3, 4] = np.nan
    for wrong, options in (
        (g, {"iterations": 0}),
        (g[1:], {}),
        (g, {"clipped": np.zeros((lab.shape[0], lab.shape[1] - 1), bool)}),
        (broken, {}),
    ):
        with pytest.raises(ValueError, match=r"photo|iteration"):
            sparse_gradients(wrong, lab.all_axes, **options)
