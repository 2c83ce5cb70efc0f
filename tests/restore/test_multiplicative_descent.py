from __future__ import annotations

import numpy as np
import pytest

from deshake.operators.planes import channels_first
from deshake.operators.shake_blur import blur_filters
from deshake.restore.multiplicative_descent import MultiplicativeDescent
from deshake.restore.total_variation import gradient
from deshake.run import Run


def descent(g, kernel, clipped=None, **options):
    settings = {"fastest": 0.0, "run": Run(1), **options}
    blur = blur_filters(kernel, channels=len(channels_first(g)))
    return MultiplicativeDescent(g, blur, clipped, **settings)


def posterior(going, g):
    """Penalised Poisson likelihood of the estimate, with its sign turned."""
    f = going.f
    Af = going.blur.forward(f).astype(np.float64)
    fit = Af - np.moveaxis(g, -1, 0) * np.log(np.maximum(Af, 1e-6))
    down, across = gradient(f)
    return fit.sum() + np.sum(going.weight * np.sqrt((down**2 + across**2).sum(0)))


@pytest.mark.parametrize("name", ["uniform", "all"])
def test_plain_steps_lower_the_penalised_likelihood(name, lab):
    g = lab.noisy(lab.shaken(lab.kernels[name], lab.colours()), 0.02)
    going = descent(g, lab.kernels[name], smooth=True)
    costs = [posterior(going, g)]
    for _ in range(8):
        going.step()
        costs.append(posterior(going, g))
    assert np.all(np.diff(costs) < 0)


def test_a_step_multiplies_by_equation_11(lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.01)
    going = descent(g, lab.all_axes)
    f, blur = going.f.copy(), going.blur
    going.step()
    expected = f * blur.adjoint(g[None] / blur.forward(f)) / np.maximum(going.coverage, 1e-2)
    known = going.coverage > 0.02
    np.testing.assert_allclose(going.f[0][known], expected[0][known], rtol=1e-4)


def test_the_photo_is_neither_copied_nor_changed(lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.colours()), 0.05) - np.float32(0.1)
    before = g.copy()
    assert (g < 0).any()
    going, from_zero = descent(g, lab.all_axes), descent(np.maximum(g, 0), lab.all_axes)
    for each in (going, from_zero):
        each.step()
    assert np.shares_memory(going.g, g)
    assert np.array_equal(g, before)
    assert np.array_equal(going.f, from_zero.f)  # light below 0 counts as 0


def test_extrapolation_goes_on_where_the_last_steps_went(lab):
    g = lab.shaken(lab.all_axes, lab.scene())
    going = descent(g, lab.all_axes, fastest=0.75)
    for _ in range(4):
        before = going.f.copy()
        going.step()
    way = going.f - before
    further = going.point - going.f
    length = np.vdot(further, way) / np.vdot(way, way)
    assert 0.2 < length <= 0.75
    np.testing.assert_allclose(further, length * way, atol=1e-3)


def test_residuals_are_those_of_the_point(lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.02)
    going = descent(g, lab.all_axes)
    residual = g - going.blur.forward(going.f)[0]
    squared, coarse = going.step()
    assert squared == pytest.approx(np.mean(np.square(residual)), rel=1e-4)
    assert coarse < squared + 1


def test_clipped_pixels_do_not_count_as_residual(lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.01)
    half = np.zeros(g.shape, bool)
    half[:, ::2] = True
    wrong = np.where(half, 1, g).astype(np.float32)
    masked = descent(wrong, lab.all_axes, half)
    masked.f[...] = masked.point[...] = descent(g, lab.all_axes).f
    squared, _ = masked.step()
    residual = (g - masked.blur.forward(descent(g, lab.all_axes).f)[0])[~half]
    assert squared == pytest.approx(np.mean(np.square(residual)), rel=1e-3)


@pytest.mark.parametrize("fastest", [0.0, 0.75])
def test_colours_do_not_affect_each_other(fastest, lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.colours()), 0.01)
    g[..., 1:] = g[..., :1]  # three alike: the extrapolation is as long as that of one
    together, alone = (descent(part, lab.all_axes, fastest=fastest) for part in (g, g[..., 0]))
    for _ in range(3):
        assert together.step() == pytest.approx(alone.step(), rel=1e-5)
    for plane in together.f:
        np.testing.assert_allclose(plane, alone.f[0], atol=1e-5)


def test_the_photo_is_left_alone(lab):
    g = lab.shaken(lab.all_axes, lab.colours()) - np.float32(0.2)
    before = g.copy()
    going = descent(g, lab.all_axes)
    going.step()
    np.testing.assert_array_equal(g, before)
    assert going.f.min() >= 0


@pytest.mark.parametrize("name", ["uniform", "all"])
@pytest.mark.parametrize("fastest", [0.0, 0.75])
def test_threads_do_not_change_a_byte(name, fastest, lab):
    g = lab.noisy(lab.shaken(lab.kernels[name], lab.colours()), 0.01)
    results = set()
    for threads in (1, 3):
        going = descent(g, lab.kernels[name], fastest=fastest, run=Run(threads))
        sums = [going.step() for _ in range(3)]
        results.add((going.f.tobytes(), *sums))
    assert len(results) == 1


def test_unseen_pixels_keep_their_value(lab):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.scene()), 0.01)
    going = descent(g, lab.all_axes)
    before = going.f.copy()
    going.step()
    hidden = going.coverage <= np.float32(1e-2)
    assert hidden.any()
    np.testing.assert_array_equal(going.f[0][hidden], before[0][hidden])
    assert np.mean(going.f[0][~hidden] != before[0][~hidden]) > 0.9


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("fastest", [0.0, 0.75])
def test_bands_and_threads_do_not_show(smooth, fastest, lab, monkeypatch):
    g = lab.noisy(lab.shaken(lab.all_axes, lab.colours()), 0.01)
    settings = {"smooth": smooth, "fastest": fastest}
    whole, banded = (descent(g, lab.all_axes, run=Run(n), **settings) for n in (1, 3))
    for _ in range(2):
        whole.step()
    monkeypatch.setattr("deshake.restore.multiplicative_descent._BAND", 7)
    for _ in range(2):
        banded.step()
    np.testing.assert_allclose(banded.f, whole.f, atol=1e-6)
