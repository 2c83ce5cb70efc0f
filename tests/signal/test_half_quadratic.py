from __future__ import annotations

import numpy as np
import pytest

from deshake.operators.filter_flow import FilterFlow
from deshake.operators.patch_inverse import PatchInverse
from deshake.run import Run
from deshake.signal.half_quadratic import _COLOUR, _POWER, HalfQuadratic
from deshake.signal.opponent import reflect, squared_lengths
from deshake.signal.shrinkage import shrunk
from tests.support.laboratory import turn

RHO, ALPHA = 0.3, 0.05


def shaken(lab, kernel, sigma):
    """Return a flow, its blur, a photo (C, h, w), and a rough estimate (C, H, W) of the scene."""
    flow = FilterFlow(kernel.camera, kernel.theta, channels=3, run=Run(1))
    photo = lab.noisy(lab.shaken(kernel, lab.colours()), sigma)
    g = np.ascontiguousarray(photo.transpose(2, 0, 1))
    f = np.pad(g, [(0, 0), *[(flow.margin, flow.margin)] * 2], mode="edge")
    return flow, flow.filters(kernel.weights), g, f


@pytest.fixture(scope="module")
def problem(lab):
    """Make a descent from a rough estimate, with uneven trust and noise."""
    flow, blur, g, f = shaken(lab, lab.all_axes, 0.01)
    rng = np.random.default_rng(8)
    m = (rng.random(lab.shape) > 0.1).astype(np.float32)
    rows = np.linspace(60, 140, flow.latent_shape[0], dtype=np.float32)
    s = np.repeat(rows[:, None], flow.latent_shape[1], 1)

    second = {
        "f_N": lab.noisy(f, 0.03, seed=4),
        "q": np.pad((0.05 + 0.1 * rng.random(lab.shape)).astype(np.float32), flow.margin),
        "tau": 0.2,
    }

    def make(*, pair=False, dark=0.0):
        more = second if pair else {}
        first, photo = np.maximum(f - dark, 0), np.maximum(g - np.float32(dark), 0)
        begin = first, blur.forward(first), photo, PatchInverse(blur)
        return HalfQuadratic(*begin, m=m, s=s, **more, run=Run(1))

    return make


def slopes(descent, f):
    down, across = np.zeros_like(f), np.zeros_like(f)
    down[:, :-1] = np.diff(f, axis=1)
    across[..., :-1] = np.diff(f, axis=2)
    return descent.s * down, descent.s * across


def energy(descent, f, w, v):
    """Return the quadratic form that a step lowers, with w the gradients and v the denoised."""
    m = descent.margin
    s = descent.s[:, m:-m, m:-m]
    data = descent.m * np.square(s * (descent.blur.forward(f) - descent.g))
    down, across = slopes(descent, f)
    smooth = squared_lengths(down - w[0], _COLOUR) + squared_lengths(across - w[1], _COLOUR)
    near = np.square(descent.s * f - v)
    parts = [data.sum(0, dtype=float), RHO * smooth, ALPHA * near.sum(0)]
    if descent.q is not None:
        parts.append(descent.q * np.square(descent.s * (f - descent.f_N)).sum(0))
    return sum(float(np.sum(part, dtype=np.float64)) for part in parts) / 2


def gradients(descent):
    """Return the best w for f, in closed form."""
    down, across = slopes(descent, descent.f)
    n = np.sqrt(squared_lengths(down, _COLOUR) + squared_lengths(across, _COLOUR))
    share = shrunk(n, descent.tau / RHO, _POWER)
    return share * down, share * across


@pytest.mark.parametrize("more", [{}, {"pair": True}, {"dark": np.float32(0.3)}])
def test_a_step_goes_down_and_exactly_as_far_as_it_helps(problem, more):
    descent = problem(**more)
    w, v = gradients(descent), descent.s * descent.f * 0.9
    before = descent.f.copy()
    start = energy(descent, before, w, v)
    descent.step(RHO, ALPHA, v)
    step = descent.f - before
    there = energy(descent, descent.f, w, v)
    assert there < 0.9 * start
    for share in (0.8, 1.2):
        assert energy(descent, before + np.float32(share) * step, w, v) > there


@pytest.mark.parametrize("pair", [False, True])
def test_the_direction_is_the_preconditioned_slope_of_the_energy(problem, pair):
    descent = problem(pair=pair)
    w, v = gradients(descent), descent.s * descent.f * 0.9
    gradient = np.empty_like(descent.f)
    kept = {}
    apply = descent.inverse.apply

    def spy(latent, rho, alpha):
        kept["gradient"] = latent.copy()
        return apply(latent, rho, alpha)

    descent.inverse.apply = spy
    before = descent.f.copy()
    descent.step(RHO, ALPHA, v)
    gradient = kept["gradient"]
    reflect(gradient)
    gradient *= descent.s
    rng = np.random.default_rng(2)
    for _ in range(3):
        along = rng.normal(size=before.shape).astype(np.float32)
        h = np.float32(3e-3)
        slope = (
            energy(descent, before + h * along, w, v) - energy(descent, before - h * along, w, v)
        ) / (2 * float(h))
        assert slope == pytest.approx(-float(np.vdot(gradient, along)), rel=2e-2)


def test_a_second_photo_that_is_trusted_wholly_is_the_result(problem):
    descent = problem(pair=True)
    descent.q = np.where(descent.q > 0, 1e4, 0).astype(np.float32)
    descent._near = np.float32(1e4)
    for _ in range(3):
        descent.step(RHO)
    m = descent.margin
    inside = np.s_[:, m:-m, m:-m]
    np.testing.assert_allclose(descent.f[inside], np.maximum(descent.f_N[inside], 0), atol=0.01)


def test_the_residual_leaves_clipped_pixels_out(problem, lab):
    descent = problem()
    clipped = np.zeros(lab.shape, bool)
    clipped[:50] = True
    squares = np.square(descent.g - descent.Af)[:, 50:].astype(float)
    assert descent.residual(clipped) == pytest.approx(np.sqrt(squares.mean()), rel=1e-5)


def test_the_blurred_estimate_follows_the_estimate(problem):
    descent = problem()
    for rho in (0.03, 0.3, 1.0):
        descent.step(rho)
    np.testing.assert_allclose(descent.Af, descent.blur.forward(descent.f), atol=2e-4)


def test_a_step_says_how_far_it_moved_the_estimate(problem):
    descent = problem()
    assert descent.moved == 0
    for rho in (0.03, 1.0):
        before = descent.f.copy()
        descent.step(rho)
        change = (descent.s * (descent.f - before)).astype(float)
        assert descent.moved == pytest.approx(np.sqrt(np.square(change).mean()), rel=1e-3)


def test_a_step_ends_at_black_where_it_would_go_below(problem):
    descent = problem(dark=np.float32(0.3))
    before = descent.f.copy()
    descent.step(RHO)
    assert np.max(descent.f - before) > 0
    fell = (before > 0.01) & (descent.f < 0.2 * before)
    assert np.count_nonzero(fell) > 100
    assert descent.f.min() >= 0


def test_a_short_step_damps_the_next_ones(lab):
    kernel = turn([(0, 0, -14), (0, 0, 14)])  # it takes other frequencies from every patch
    flow, blur, g, f = shaken(lab, kernel, 0.003)
    m, s = np.ones(lab.shape, np.float32), np.full(flow.latent_shape, 150, np.float32)

    def result(*, damped):
        descent = HalfQuadratic(
            f.copy(), blur.forward(f), g, PatchInverse(blur), m=m, s=s, run=Run(1)
        )
        for rho in np.geomspace(0.02, 1, 5):
            descent.step(rho)
            if not damped:
                descent._damping = 0.0
        return descent

    damped, plain = result(damped=True), result(damped=False)
    assert damped._damping > 0
    assert damped.residual(None) < 0.98 * plain.residual(None)


@pytest.mark.parametrize("pair", [False, True])
def test_filters_of_other_patches_may_take_their_place(problem, lab, pair):
    descent, kernel = problem(pair=pair), lab.all_axes
    flow = FilterFlow(kernel.camera, kernel.theta, hop=30, rough=True, channels=3, run=Run(1))
    descent.replace_filters(PatchInverse(flow.filters(kernel.weights)))
    np.testing.assert_array_equal(descent.Af, descent.blur.forward(descent.f))
    w, v = gradients(descent), descent.s * descent.f * 0.9
    start = energy(descent, descent.f, w, v)
    descent.step(RHO, ALPHA, v)
    assert energy(descent, descent.f, w, v) < 0.9 * start


def test_untrusted_pixels_do_not_count(problem):
    one, other = problem(), problem()
    other.g = np.where(other.m > 0, other.g, 5).astype(np.float32)
    for descent in (one, other):
        descent.step(RHO)
    np.testing.assert_array_equal(one.f, other.f)
