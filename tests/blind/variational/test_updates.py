from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq
from scipy.special import digamma, gammaln

from deshake.blind.variational import priors
from deshake.blind.variational.posterior import (
    Posterior,
    rectified_moments,
    start,
)
from deshake.blind.variational.priors import KERNEL_PRIOR, GaussianMixture
from deshake.blind.variational.updates import VariationalModel
from deshake.geometry.camera import Camera
from deshake.geometry.rotations import grid_steps
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.shake_blur import observation_mask
from deshake.operators.warps import Warps
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable

SHAPE = 13, 15
SHIFTS = np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -2), (2, 1), (-1, -1)])  # px, as x, y
PRIOR = GaussianMixture(np.array([0.3, 0.7]), np.array([0.2, 6.0]))
INNER = 3  # px that the latent gradients of the exact case keep off the border


class Dense:
    """The formulas of the variational model written out, in float64."""

    def __init__(self, c: np.ndarray, g: np.ndarray, mask: np.ndarray) -> None:
        self.c = c
        self.g = g.reshape(2, -1).astype(np.float64)
        self.m = mask.ravel().astype(np.float64)
        self.squares = c**2

    def error(self, q: Posterior) -> float:
        """E of the squared residual: four terms for each observed gradient."""
        a = self.c @ q.w
        total = 0.0
        for g, f, var in zip(self.g, rows(q.f), rows(q.f_var), strict=True):
            b = np.einsum("ijk,j->ik", self.c, f)
            spread = np.einsum("ijk,j,k->i", self.squares, var, q.w_var)
            each = (g - b @ q.w) ** 2 + b**2 @ q.w_var + a**2 @ var + spread
            total += float(self.m @ each)
        return total

    def free_energy(self, q: Posterior, lam: np.ndarray | None = None) -> float:
        """C_KL of Eq. (10); responsibilities of the gradients are the best ones unless given."""
        count = 2 * self.m.sum()
        shape = count / 2 + 1e-3
        rate = shape / q.beta
        log_beta = digamma(shape) - np.log(rate)
        log_p = 1e-3 * np.log(1e-3) - gammaln(1e-3) + (1e-3 - 1) * log_beta - 1e-3 * q.beta
        noise = -stats.gamma(shape, scale=1 / rate).entropy() - log_p
        second = (q.f.astype(np.float64) ** 2 + q.f_var).ravel()[:, None]
        if lam is None:
            lam = responsibilities(second)
        gamma, pi = PRIOR.gamma, PRIOR.pi
        latent = lam * (
            np.log(lam) - np.log(pi) - np.log(gamma / (2 * np.pi)) / 2 + gamma * second / 2
        )
        rates = KERNEL_PRIOR.rate
        kappa = q.rho * rates * np.exp(-rates * q.w[:, None])
        kappa /= kappa.sum(1, keepdims=True)
        kernel = kappa * (np.log(kappa) - np.log(q.rho * rates) + rates * q.w[:, None])
        return float(
            q.beta / 2 * self.error(q)
            - count / 2 * (log_beta - np.log(2 * np.pi))
            + noise
            - 0.5 * np.log(2 * np.pi * np.e * q.f_var.astype(np.float64)).sum()
            + latent.sum()
            + q.w_entropy.sum()
            + kernel.sum()
            - np.log(q.rho).sum()
        )


def rows(image: np.ndarray) -> np.ndarray:
    return image.reshape(2, -1).astype(np.float64)


def responsibilities(second: np.ndarray) -> np.ndarray:
    lam = PRIOR.pi * np.sqrt(PRIOR.gamma) * np.exp(-PRIOR.gamma * second / 2)
    return lam / lam.sum(1, keepdims=True)


def posterior(shape: tuple[int, int], count: int, *, inner: int = 0) -> Posterior:
    """Make an arbitrary q; its gradients vanish near the border."""
    rng = np.random.default_rng(1)
    f, f_var = rng.normal(size=(2, *shape)), rng.random((2, *shape)) + 0.05
    if inner:
        keep = np.zeros(shape)
        keep[inner:-inner, inner:-inner] = 1
        f, f_var = f * keep, np.maximum(f_var * keep, 1e-7)
    w_var = rng.random(count) * 0.01
    return Posterior(
        f.astype(np.float32),
        f_var.astype(np.float32),
        rng.random(count) / count,
        w_var,
        rng.normal(size=count),
        0.7,
        np.array([0.1, 0.2, 0.3, 0.4]),
    )


class Case(NamedTuple):
    """A model and its dense counterpart."""

    model: VariationalModel
    dense: Dense


@pytest.fixture(scope="module")
def exact(dense_weights: Callable[..., np.ndarray]) -> Callable[..., Case]:
    """Make models of whole-pixel shifts: there filter flow makes no error."""
    camera = Camera.uniform(*SHAPE)
    theta = np.stack([-SHIFTS[:, 1], SHIFTS[:, 0], 0 * SHIFTS[:, 0]], 1) / camera.focal_px
    c = dense_weights(camera, theta)

    def make(*, masked: bool) -> Case:
        rng = np.random.default_rng(0)
        g = rng.normal(size=(2, *SHAPE)).astype(np.float32)
        mask = np.ones(SHAPE, np.float32)
        if masked:
            mask[rng.random(SHAPE) < 0.2] = 0
        flow = FilterFlow(camera, theta, margin=0, hop=8, channels=2, run=Run(1))
        return Case(VariationalModel(flow, g, mask, PRIOR), Dense(c, g, mask))

    return make


def slope(function: Callable[[float], float], at: float, step: float) -> float:
    return (function(at + step) - function(at - step)) / (2 * step)


def changed(image: np.ndarray, place: tuple[int, ...], value: float) -> np.ndarray:
    out = image.astype(np.float64)
    out[place] = value
    return out


def test_expected_error_and_gram_are_the_dense_ones(exact: Callable[..., Case]) -> None:
    model, dense = exact(masked=False)
    q = posterior(SHAPE, len(SHIFTS), inner=INNER)
    problem = model.kernel_problem(q)
    assert model.squared_error(q, problem) == pytest.approx(dense.error(q), rel=1e-5)
    b = np.einsum("ijk,cj->cik", dense.c, rows(q.f))
    covariance = np.einsum("ijk,ijl,cj->kl", dense.c, dense.c, rows(q.f_var), optimize=True)
    diagonal = (b**2).sum((0, 1)) + np.diag(covariance)
    np.testing.assert_allclose(np.diag(problem.gram), diagonal, rtol=1e-5)


def test_the_variances_products_are_the_dense_ones(exact: Callable[..., Case]) -> None:
    model, dense = exact(masked=True)
    q = posterior(SHAPE, len(SHIFTS))
    product = model._variance_product(q.w, model.kernel_problem(q))
    expected = np.einsum(
        "i,ijk,ijl,cj,l->k", dense.m, dense.c, dense.c, rows(q.f_var), q.w, optimize=True
    )
    np.testing.assert_allclose(product, expected, rtol=1e-5)


def test_the_latent_update_solves_the_dense_system(exact: Callable[..., Case]) -> None:
    model, dense = exact(masked=True)
    q = posterior(SHAPE, len(SHIFTS))
    new = model.update_latent(q, iterations=300)
    a = dense.c @ q.w
    gam = responsibilities((rows(q.f) ** 2 + rows(q.f_var)).ravel()[:, None]) @ PRIOR.gamma
    gam = gam.reshape(2, -1)
    spread = np.einsum("i,ijk,k->j", dense.m, dense.squares, q.w_var)
    x2 = q.beta * (dense.m @ a**2 + spread) + gam
    np.testing.assert_allclose(rows(new.f_var), 1 / x2, rtol=1e-4)
    system = np.einsum("i,ij,il->jl", dense.m, a, a)
    for k, var in enumerate(q.w_var):
        system += var * np.einsum("i,ij,il->jl", dense.m, dense.c[..., k], dense.c[..., k])
    for channel in range(2):
        target = q.beta * a.T @ (dense.m * dense.g[channel])
        f = np.linalg.solve(q.beta * system + np.diag(gam[channel]), target)
        np.testing.assert_allclose(rows(new.f)[channel], f, atol=1e-4 * np.abs(f).max())


def test_no_gradient_is_left_after_the_latent_update(exact: Callable[..., Case]) -> None:
    model, dense = exact(masked=True)
    q = posterior(SHAPE, len(SHIFTS))
    lam = responsibilities((rows(q.f) ** 2 + rows(q.f_var)).ravel()[:, None])
    new = model.update_latent(q, iterations=300)

    def along_mean(state: Posterior, place: tuple[int, ...]) -> float:
        def energy(value: float) -> float:
            return dense.free_energy(replace(state, f=changed(state.f, place, value)), lam)

        return slope(energy, float(state.f[place]), 1e-3)

    def along_variance(state: Posterior, place: tuple[int, ...]) -> float:
        def energy(value: float) -> float:
            return dense.free_energy(replace(state, f_var=changed(state.f_var, place, value)), lam)

        at = float(state.f_var[place])
        return at * slope(energy, at, 1e-3 * at)

    for place in ((0, 0, 0), (0, 5, 7), (1, 6, 2), (1, 12, 14), (0, 2, 13)):
        before, after = along_mean(q, place), along_mean(new, place)
        assert abs(after) < 2e-3 * max(abs(before), 1)
        before, after = along_variance(q, place), along_variance(new, place)
        assert abs(after) < 2e-3 * max(abs(before), 0.1)


def test_no_gradient_is_left_after_the_kernel_updates(exact: Callable[..., Case]) -> None:
    model, dense = exact(masked=False)
    q = posterior(SHAPE, len(SHIFTS), inner=INNER)
    problem = model.kernel_problem(q)
    for _ in range(40):
        q = model.update_kernel(q, problem, sweeps=20)

    def along(k: int, x1: float) -> float:
        """C_KL where the natural parameter of weight k is x1."""
        mean, second, entropy = rectified_moments(x1, q.beta * problem.gram[k, k])
        parts = {"w": (q.w, mean), "w_var": (q.w_var, second - mean**2)}
        state = {name: changed(old, (k,), new) for name, (old, new) in parts.items()}
        state["w_entropy"] = changed(q.w_entropy, (k,), entropy)
        return dense.free_energy(replace(q, **state))

    for k in range(len(SHIFTS)):
        x2 = q.beta * problem.gram[k, k]

        def excess(x1: float, k: int = k, x2: float = x2) -> float:
            return rectified_moments(x1, x2)[0] - q.w[k]

        x1 = brentq(excess, -1e6, 1e6, xtol=1e-9, rtol=1e-14)
        step = 0.02 * np.sqrt(x2)
        steep = abs(slope(lambda x, k=k: along(k, x), x1 + 25 * step, step))
        assert abs(slope(lambda x, k=k: along(k, x), x1, step)) < 5e-3 * steep


def test_the_noise_update_finds_the_lowest_free_energy(exact: Callable[..., Case]) -> None:
    model, dense = exact(masked=False)
    q = posterior(SHAPE, len(SHIFTS), inner=INNER)
    problem = model.kernel_problem(q)
    best = model.update_noise(q, problem)
    for factor in (0.9, 0.99, 1.01, 1.1):
        other = replace(best, beta=best.beta * factor)
        assert dense.free_energy(other) > dense.free_energy(best)
        assert model.free_energy(other, problem) > model.free_energy(best, problem)


def test_free_energy_is_the_dense_one(exact: Callable[..., Case]) -> None:
    model, dense = exact(masked=False)
    q = posterior(SHAPE, len(SHIFTS), inner=INNER)
    energy = model.free_energy(q, model.kernel_problem(q))
    assert energy == pytest.approx(dense.free_energy(q), abs=1e-4 * 2 * dense.m.sum())


def test_a_tiny_rotational_case_is_nearly_the_dense_one(
    dense_weights: Callable[..., np.ndarray],
) -> None:
    shape, inner = (24, 30), 6
    camera = Camera.from_focal(30.0, *shape)
    rng = np.random.default_rng(2)
    theta = rng.uniform(-1.5, 1.5, (7, 3)) * grid_steps(camera)
    mask = observation_mask(camera, theta)
    q = posterior(shape, 7, inner=inner)
    smooth = cv2.GaussianBlur(q.f.transpose(1, 2, 0), (0, 0), 1.2).transpose(2, 0, 1)
    q = replace(q, f=4 * smooth)
    flow = FilterFlow(camera, theta, margin=0, hop=4, channels=2, run=Run(1))
    g = flow.filters(rng.random(7) / 4).forward(q.f) + 0.3 * rng.normal(size=q.f.shape)
    model = VariationalModel(flow, g.astype(np.float32), mask, PRIOR)
    dense = Dense(dense_weights(camera, theta), g, mask)
    problem = model.kernel_problem(q)
    assert model.squared_error(q, problem) == pytest.approx(dense.error(q), rel=0.02)
    q = replace(q, w_var=30 * q.w_var)
    new = model.update_latent(q)
    a = dense.c @ q.w
    lam = responsibilities((rows(q.f) ** 2 + rows(q.f_var)).ravel()[:, None])
    x2 = (lam @ PRIOR.gamma).reshape(2, -1) + q.beta * (
        dense.m @ a**2 + np.einsum("i,ijk,k->j", dense.m, dense.squares, q.w_var)
    )
    np.testing.assert_allclose(rows(new.f_var), 1 / x2, rtol=0.05)


class Shaken(NamedTuple):
    """Gradients of a shaken photograph, and the model of all rotations near."""

    model: VariationalModel
    begin: Posterior


def shaken(sharp: np.ndarray, *, uniform: bool) -> Shaken:
    height, width = 60, 76
    photo = cv2.resize(sharp, (width + 32, height + 32), interpolation=cv2.INTER_AREA) * 256
    camera = Camera.uniform(height, width)
    if not uniform:
        camera = Camera.from_focal(width, height, width)
    reach = np.arange(-2, 3)
    around = np.meshgrid(reach, reach, [0] if uniform else reach, indexing="ij")
    indices = np.stack(around, -1).reshape(-1, 3)
    theta = indices * grid_steps(camera)
    along = indices[:, 1] if uniform else indices[:, 2]
    true = (indices[:, 0] == 0) & (indices[:, 1] == along)
    blurred = Warps(camera, theta, margin=16).blur(photo, true / true.sum())
    blurred += np.random.default_rng(0).normal(0, 0.5, blurred.shape).astype(np.float32)
    g = np.zeros((2, height, width), np.float32)
    g[0, :, :-1], g[1, :-1] = np.diff(blurred, axis=1), np.diff(blurred, axis=0)
    flow = FilterFlow(camera, theta, margin=0, hop=16, channels=2, run=Run(1))
    model = VariationalModel(flow, g, observation_mask(camera, theta), priors.gradients(0))
    near = np.abs(indices).max(1) <= 1
    return Shaken(model, start(g, near / near.sum()))


@pytest.mark.parametrize("uniform", [True, False])
def test_free_energy_falls_at_every_update(sharp: np.ndarray, *, uniform: bool) -> None:
    model, q = shaken(sharp, uniform=uniform)
    energy = model.free_energy(q, model.kernel_problem(q))
    for _ in range(12):
        latent = model.update_latent(q)
        problem = model.kernel_problem(latent)
        kernel = model.update_kernel(latent, problem)
        noise = model.update_noise(kernel, problem)
        for q in (latent, kernel, noise):
            new = model.free_energy(q, problem)
            assert new < energy + 1e-6 * abs(energy)
            energy = new
    assert np.isfinite(energy)


def test_turns_about_the_axis_cost_what_their_rate_says(sharp: np.ndarray) -> None:
    model, begin = shaken(sharp, uniform=False)
    camera, g = model.flow.camera, model.g
    step = grid_steps(camera)[2]
    strict = VariationalModel(model.flow, g, model.mask, model.prior, roll_rate=0.5, roll_step=step)
    problem = model.kernel_problem(begin)
    rolls = np.abs(model.flow.theta[:, 2]) / step
    extra = strict.free_energy(begin, problem) - model.free_energy(begin, problem)
    assert extra == pytest.approx(0.5 * model.count * float(rolls @ begin.w), rel=1e-6)
    mean = []
    for each in (model, strict):
        q = begin
        for _ in range(6):
            q = each.update_latent(q)
            problem = each.kernel_problem(q)
            q = each.update_noise(each.update_kernel(q, problem), problem)
        mean.append(float(rolls @ q.w) / q.w.sum())
    assert mean[0] > 0.6  # the true kernel's is 1.2
    assert mean[1] < 0.05
