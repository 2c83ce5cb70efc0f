from __future__ import annotations

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import reach
from deshake.operators.shake_blur import ShakeBlur, blur_filters
from deshake.restore.richardson_lucy import richardson_lucy
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run
from tests.support.laboratory import turn

NAMES = ("uniform", "pan", "roll", "all")
WIDE_ROLL = turn([(0, 0, -20), (0, 0, 20)])  # its restoration does not settle in five stages


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


def test_a_wrong_kernel_does_little_harm(lab):
    rng = np.random.default_rng(3)
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.01)
    weights = lab.all_axes.weights * np.exp(rng.normal(0, 0.5, len(lab.all_axes.weights)))
    wrong = RotationKernel(
        lab.all_axes.theta, weights / weights.sum(), lab.all_axes.steps, lab.camera
    ).above(0.2)
    f = sparse_gradients(g, wrong).pixels
    assert lab.psnr(f, lab.frame(sharp)) > lab.psnr(g, lab.frame(sharp)) + 1


def test_a_still_camera_changes_little(lab):
    g = np.ascontiguousarray(lab.frame(lab.scene()))
    f = sparse_gradients(g, RotationKernel.delta(lab.camera)).pixels
    assert lab.psnr(f, g) > 40


@pytest.mark.parametrize("sigma", [0.003, 0.02])
def test_more_stages_do_better(sigma, lab):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), sigma)
    one, seven = (sparse_gradients(g, lab.all_axes, iterations=n) for n in (1, 7))
    assert (one.iterations, seven.iterations) == (1, 7)
    frame = lab.frame(sharp)
    assert lab.psnr(seven.pixels, frame) > lab.psnr(one.pixels, frame) + 0.5


def test_stages_go_on_if_the_last_one_still_moves_the_estimate(lab):
    sharp = lab.scene()
    g = lab.noisy(lab.shaken(WIDE_ROLL, sharp), 0.003)
    usual, five = sparse_gradients(g, WIDE_ROLL), sparse_gradients(g, WIDE_ROLL, iterations=5)
    assert (usual.iterations, five.iterations) == (10, 5)
    frame = lab.frame(sharp)
    assert lab.psnr(usual.pixels, frame) > lab.psnr(five.pixels, frame) + 0.15
    assert usual.residual < five.residual
    assert sparse_gradients(g, WIDE_ROLL, quality="fast").iterations == 3
    settled = lab.noisy(lab.shaken(lab.all_axes, sharp), 0.003)
    assert sparse_gradients(settled, lab.all_axes).iterations == 5


@pytest.mark.parametrize(
    ("ends", "turned", "least"),
    [((0, 0, 14), False, -0.1), ((6, 14, 4), False, -0.1), ((9, 20, 18), True, -0.2)],
)
def test_rough_filters_of_a_large_photo_do_not_show(ends, turned, least, monkeypatch, lab):
    camera = Camera.from_focal(1100.0, 980, 1060)
    kernel = turn([(0, 0, 0), ends], camera)
    beyond = reach(camera, kernel.theta) + 2
    scenes = [[lab.scene(5 * row + column) for column in range(5)] for row in range(6)]
    sharp = np.ascontiguousarray(np.block(scenes)[: 980 + 2 * beyond, : 1060 + 2 * beyond])
    g = lab.noisy(ShakeBlur(kernel, margin=beyond, kind="warps").forward(sharp), 0.003)
    made = []

    def spy(*args, rough=False, **more):
        made.append(rough)
        return blur_filters(*args, rough=rough, **more)

    monkeypatch.setattr("deshake.restore.sparse_gradients.blur_filters", spy)
    rough = sparse_gradients(g, kernel).pixels
    assert made == ([True, False] if turned else [True])  # a short step asks for exact filters
    monkeypatch.setattr("deshake.restore.sparse_gradients._LARGE", g.size)
    exact = sparse_gradients(g, kernel).pixels
    assert made[-1] is False
    frame = sharp[beyond:-beyond, beyond:-beyond]
    assert lab.psnr(exact, frame) > lab.psnr(g, frame) + 5
    assert lab.psnr(rough, frame) > lab.psnr(exact, frame) + least


def test_bands_do_not_show(monkeypatch, lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.003)
    module = "deshake.signal.half_quadratic"
    whole = sparse_gradients(g, lab.all_axes).pixels
    monkeypatch.setattr(f"{module}._BAND_PIXELS", 1)
    np.testing.assert_allclose(sparse_gradients(g, lab.all_axes).pixels, whole, atol=1e-4)


@pytest.mark.parametrize("stages", [5, 10])
def test_progress_is_reported(stages, lab):
    reports = []
    kernel = WIDE_ROLL if stages == 10 else lab.all_axes
    g = lab.noisy(lab.shaken(kernel, lab.scene()), 0.003)
    sparse_gradients(g, kernel, run=Run(progress=lambda part, text: reports.append((part, text))))
    parts = [part for part, _ in reports]
    assert parts == sorted(parts)
    assert 0 < parts[0] < 0.2
    assert parts[-1] == 1
    assert parts.count(1) == 1
    assert reports[-1][1] == f"deblurring, stage {stages}"
