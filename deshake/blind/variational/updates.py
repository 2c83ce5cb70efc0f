"""Variational inference of the sharp gradients and the kernel (Sec. 5, Eq. (10)).

After Miskin & MacKay (2000) and Fergus et al. (2006), with the rotational model in the place of
convolution. The photo's gradients are ``g_i = sum_k w_k sum_j C_ijk f_j + eps``, with
``eps ~ N(0, 1/beta)``; both directions share the kernel. The posterior is approximated by

    q = prod_j N(f_j; F_j, var_j)  prod_k Rect(w_k; x1_k, x2_k)  q(beta)

where ``Rect`` is a Gaussian ``exp(-x2 w^2 / 2 + x1 w)`` restricted to ``w >= 0``. Each update
minimises the free energy C_KL over one of the factors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, pi
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, gammaln

from deshake.blind.variational.posterior import (
    Posterior,
    gradient_precision,
    rectified_moments,
    weight_rate,
)
from deshake.blind.variational.priors import KERNEL_PRIOR, ExponentialMixture, GaussianMixture
from deshake.operators.local_filters import LocalFilters

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.operators.filter_flow import FilterFlow
    from deshake.operators.strips import Strip

__all__ = ["KernelProblem", "VariationalModel"]

Image = NDArray[np.float32]
Vector = NDArray[np.float64]

_SHAPE = _SCALE = 1e-3  # p(beta) = Gamma(a0, b0)


@dataclass(frozen=True, eq=False)
class KernelProblem:
    """The quadratic form of the kernel under q(f).

    Parameters
    ----------
    gram : (K, K) array
        ``G_kl = sum_i m_i (B_ik B_il + sum_j C_ijk C_ijl var_j)``, approximately.
    local_variances : dict
        ``V_p(u) = sum_c sum_i win_p(i) m_i var_c(i + u)`` of each strip's patches.

    """

    gram: Vector
    local_variances: dict[Strip, Image]


class VariationalModel:
    """The data of one scale and the updates of q.

    Parameters
    ----------
    flow : FilterFlow
        The rotations of the active region, without a margin.
    g : (C, h, w) array
        Gradients of the blurred photo.
    mask : (h, w) array
        Observed pixels m: 1 where the rotational model explains the gradient fully.
    prior : GaussianMixture
        Prior of the sharp gradients at this scale.
    roll_rate : float
        Rate of the kernel prior's factor ``exp(-roll_rate N |theta_Z| / step w)``, in nats per
        observed gradient and grid step of `roll_step`.
    roll_step : float
        Grid spacing about Z in radians.

    """

    def __init__(
        self,
        flow: FilterFlow,
        g: Image,
        mask: Image,
        prior: GaussianMixture,
        *,
        roll_rate: float = 0.0,
        roll_step: float = 1.0,
    ) -> None:
        self.flow = flow
        self.g = g * mask
        self.mask = mask
        self.prior = prior
        self.count = len(g) * float(mask.sum(dtype=np.float64))
        self.roll = roll_rate * self.count * np.abs(flow.theta[:, 2]) / roll_step

    def update_latent(self, q: Posterior, *, iterations: int = 5) -> Posterior:
        """Update q(f): precisions exactly, means by preconditioned conjugate gradients.

        The means minimise a convex quadratic, so a few iterations lower C_KL.
        """
        blur = self.flow.filters(q.w)
        squares = self.flow.filters(q.w_var, power=2)
        gam, _ = gradient_precision(q.f * q.f + q.f_var, self.prior)
        beta = np.float32(q.beta)
        # the precisions are beta (D1 + D2) + Gam
        d1 = _squared(blur).adjoint(self.mask[None])
        d2 = squares.adjoint(self.mask[None])
        x2 = beta * np.maximum(d1 + d2, 0) + gam
        spread = self._kernel_spread(q.w_var)
        # approximate the part of the kernel's variances: symmetric, with D2 as its diagonal
        root = np.sqrt(np.maximum(d2, 0) / max(float(spread[1, 1]), 1e-30))[0]

        def system(f: Image) -> Image:
            # [beta (A'mA + sum_k var_k W_k'mW_k) + Gam] f
            out = blur.adjoint(self.mask * blur.forward(f))
            for c in range(len(f)):
                out[c] += root * cv2.filter2D(
                    root * f[c], -1, spread, borderType=cv2.BORDER_CONSTANT
                )
            out *= beta
            out += gam * f
            return out

        target = beta * blur.adjoint(self.g)
        f = _conjugate_gradients(system, target, q.f, 1 / x2, iterations)
        return replace(q, f=f, f_var=1 / x2)

    def kernel_problem(self, q: Posterior) -> KernelProblem:
        """Compute the kernel's quadratic form; valid for all q with the same f and f_var."""
        ones = np.broadcast_to(self.mask, self.g.shape)
        local = dict(self.flow.grid.cross_correlations(ones, q.f_var, lambda _, v: v.copy()))
        f, variance = np.moveaxis(q.f, 0, -1), np.moveaxis(q.f_var, 0, -1)
        return KernelProblem(self.flow.gram(f, self.mask, variance), local)

    def update_kernel(self, q: Posterior, problem: KernelProblem, *, sweeps: int = 10) -> Posterior:
        """Update q(w) by Gauss-Seidel sweeps, each weight's factor exactly in turn.

        ``x2_k = beta G_kk`` and ``x1_k = beta (h_k - sum_{l != k} G_kl W_l) - R_k``. R_k includes
        the rate of the roll's prior. The Gram matrix is approximate, the gradient is not:
        ``h = B^T r + B^T B W``.
        """
        residual = np.moveaxis(self._residual(q), 0, -1)
        gram = problem.gram
        gradient = self.flow.kernel_adjoint(np.moveaxis(q.f, 0, -1), residual)
        h = gradient - self._variance_product(q.w, problem) + gram @ q.w
        diagonal = np.maximum(np.diag(gram), 1e-9)
        w, w_var, entropy, rho = q.w.copy(), q.w_var.copy(), q.w_entropy.copy(), q.rho
        product = gram @ w
        for _ in range(sweeps):
            rate, rho, _ = weight_rate(w, ExponentialMixture(rho, KERNEL_PRIOR.rate))
            rate += self.roll
            for k in range(len(w)):
                x2 = q.beta * diagonal[k]
                x1 = q.beta * (h[k] - product[k] + diagonal[k] * w[k]) - rate[k]
                mean, second, entropy[k] = rectified_moments(x1, x2)
                change = mean - w[k]
                if change != 0:
                    product += gram[k] * change
                    w[k] = mean
                w_var[k] = max(second - mean * mean, 1e-14)
        return replace(q, w=w, w_var=w_var, w_entropy=entropy, rho=rho)

    def update_noise(self, q: Posterior, problem: KernelProblem) -> Posterior:
        """Update q(beta): ``beta = (N/2 + a0) / (E/2 + b0)``."""
        error = self.squared_error(q, problem)
        return replace(q, beta=(self.count / 2 + _SHAPE) / (error / 2 + _SCALE))

    def squared_error(self, q: Posterior, problem: KernelProblem) -> float:
        """Expected squared error E of the observed gradients under q."""
        residual = self._residual(q).astype(np.float64)
        kernel_part = float(q.w_var @ np.diag(problem.gram))
        latent_part = float(q.w @ self._variance_product(q.w, problem))
        return float(np.vdot(residual, residual)) + latent_part + kernel_part

    def free_energy(self, q: Posterior, problem: KernelProblem) -> float:
        """C_KL of Eq. (10), in nats."""
        _, prior_f = gradient_precision(q.f * q.f + q.f_var, self.prior)
        _, _, prior_w = weight_rate(q.w, ExponentialMixture(q.rho, KERNEL_PRIOR.rate))
        shape = self.count / 2 + _SHAPE
        rate = shape / q.beta
        log_beta = float(digamma(shape)) - log(rate)
        noise = (  # KL(q(beta) || p(beta)) of two Gamma densities
            (shape - _SHAPE) * float(digamma(shape))
            - float(gammaln(shape))
            + float(gammaln(_SHAPE))
            + _SHAPE * (log(rate) - log(_SCALE))
            + shape * (_SCALE - rate) / rate
        )
        return (
            q.beta / 2 * self.squared_error(q, problem)
            - self.count / 2 * (log_beta - log(2 * pi))
            + noise
            - 0.5 * float(np.log(2 * pi * np.e * q.f_var).sum(dtype=np.float64))
            + prior_f
            + float(q.w_entropy.sum())
            + prior_w
            + float(self.roll @ q.w)
            - float(np.log(q.rho).sum())  # the shares' Dirichlet prior, of exponent 1
        )

    def _residual(self, q: Posterior) -> Image:
        residual: Image = self.g - self.mask * self.flow.filters(q.w).forward(q.f)
        return residual

    def _variance_product(self, w: Vector, problem: KernelProblem) -> Vector:
        """``(S W)_k = sum_i m_i sum_j C_ijk A_ij var_j``."""
        filters = self.flow.filters(w).filters
        total = np.zeros(len(w))
        for strip, local in problem.local_variances.items():
            index, share = self.flow.taps(strip)
            spread = (local * filters(strip)).reshape(strip.count, -1).astype(np.float64)
            for p in range(strip.count):
                total += (spread[p][index[p]] * share[p]).sum(-1)
        return total

    def _kernel_spread(self, w_var: Vector) -> Image:
        """Average over the frame of ``sum_k var_k W_k'W_k``, a 3 x 3 filter."""
        spread = np.zeros((3, 3))
        corners = ((0, 0), (0, 1), (1, 0), (1, 1))
        patches = 0
        for strip in self.flow.grid.strips:
            _, share = self.flow.taps(strip)
            patches += strip.count
            for a, (ya, xa) in enumerate(corners):
                for b, (yb, xb) in enumerate(corners):
                    together = (share[..., a] * share[..., b]).sum(0, dtype=np.float64)
                    spread[1 + ya - yb, 1 + xa - xb] += together @ w_var
        return (spread / patches).astype(np.float32)


def _squared(blur: LocalFilters) -> LocalFilters:
    """Return the operator whose filters are the squares of another's."""
    return LocalFilters(blur.grid, lambda strip: np.square(blur.filters(strip)))


def _conjugate_gradients(
    system: Callable[[Image], Image], target: Image, x: Image, inverse: Image, iterations: int
) -> Image:
    """Solve ``system(x) = target`` from x with a Jacobi preconditioner."""
    residual = target - system(x)
    z: Image = inverse * residual
    direction = z
    product = float(np.vdot(residual, z))
    for _ in range(iterations):
        image = system(direction)
        curvature = float(np.vdot(direction, image))
        if curvature <= 0 or product <= 0:
            break
        step = np.float32(product / curvature)
        x = x + step * direction
        residual = residual - step * image
        z = inverse * residual
        previous, product = product, float(np.vdot(residual, z))
        direction = z + np.float32(product / previous) * direction
    return x
