from __future__ import annotations

import numpy as np
import pytest

from deshake.operators.filter_flow import FilterFlow
from deshake.operators.patch_inverse import PatchInverse
from deshake.restore.plug_and_play import plug_and_play
from deshake.restore.sparse_gradients import sparse_gradients
from deshake.run import Run
from deshake.signal.half_quadratic import HalfQuadratic

SIGMA = 0.01


@pytest.fixture(scope="module")
def start(lab):
    """Make a descent from the default's estimate; the sharp scene is known."""
    kernel = lab.all_axes
    sharp = lab.colours()
    g = lab.noisy(lab.shaken(kernel, sharp), SIGMA)
    flow = FilterFlow(kernel.camera, kernel.theta, channels=3, run=Run(1))
    blur = flow.filters(kernel.weights)
    m = flow.margin
    first = sparse_gradients(g, kernel).pixels.transpose(2, 0, 1)
    f = np.pad(first, ((0, 0), (m, m), (m, m)), mode="edge")
    planes = np.ascontiguousarray(g.transpose(2, 0, 1))
    s = np.full(flow.latent_shape, 1 / SIGMA, np.float32)

    def make(threads=1):
        m = np.ones(lab.shape, np.float32)
        begin = f.copy(), blur.forward(f), planes, PatchInverse(blur)
        return HalfQuadratic(*begin, m=m, s=s, run=Run(threads))

    return make, flow.margin


def test_the_result_of_sparse_gradients_is_improved(start, lab):
    make, m = start
    descent = make()
    sharp = lab.frame(lab.colours()).transpose(2, 0, 1)

    def quality():
        return lab.psnr(descent.f[:, m:-m, m:-m], sharp)

    first = quality()
    plug_and_play(descent, stages=4, run=Run())
    assert quality() > first + 0.2
    frame = descent.f[:, m:-m, m:-m]
    np.testing.assert_allclose(frame.mean((1, 2)), sharp.mean((1, 2)), rtol=0.01)
    np.testing.assert_allclose(descent.Af, descent.blur.forward(descent.f), atol=2e-4)


def test_threads_do_not_change_a_byte(start):
    make, _ = start
    results = []
    for threads in (1, 3):
        descent = make(threads)
        plug_and_play(descent, stages=1, run=Run(threads))
        results.append(descent.f.tobytes())
    assert results[0] == results[1]


def test_each_stage_is_reported(start):
    make, _ = start
    reports = []
    plug_and_play(
        make(), stages=2, run=Run(progress=lambda share, text: reports.append((share, text)))
    )
    assert [share for share, _ in reports] == [0.5, 1]
    assert "stage 2" in reports[1][1]


@pytest.mark.parametrize(("scene", "gain"), [("scene", 0.0), ("colours", -0.2)])
def test_high_quality_is_reached_by_name(lab, scene: str, gain: float):
    sharp = getattr(lab, scene)()
    g = lab.noisy(lab.shaken(lab.all_axes, sharp), SIGMA)
    by_level = {
        level: lab.psnr(sparse_gradients(g, lab.all_axes, quality=level).pixels, lab.frame(sharp))
        for level in ("fast", "default", "high")
    }
    assert by_level["fast"] < by_level["default"] - 0.2
    assert by_level["high"] > by_level["default"] + gain  # discs have no texture to gain by
    assert by_level["high"] != by_level["default"]
