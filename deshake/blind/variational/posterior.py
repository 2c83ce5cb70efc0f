"""The approximate posterior q of the variational estimator, and the moments of its factors.

``q = prod_j N(f_j; F_j, var_j) prod_k Rect(w_k; x1_k, x2_k) q(beta)``, where ``Rect`` is a Gaussian
``exp(-x2 w^2 / 2 + x1 w)`` restricted to ``w >= 0`` (Miskin & MacKay 2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log, pi, sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erfcx

from deshake.blind.variational.priors import KERNEL_PRIOR

if TYPE_CHECKING:
    from deshake.blind.variational.priors import ExponentialMixture, GaussianMixture

__all__ = ["Posterior", "gradient_precision", "rectified_moments", "start", "weight_rate"]

Image = NDArray[np.float32]
Vector = NDArray[np.float64]

_FAR = 25.0  # |t| of `rectified_moments`: beyond it, series give the moments


@dataclass(frozen=True, eq=False)
class Posterior:
    """The approximate posterior q of one scale.

    Parameters
    ----------
    f, f_var : (C, h, w) arrays
        Mean and variance of the sharp gradients.
    w, w_var : (K,) arrays
        Mean and variance of the kernel's weights.
    w_entropy : (K,) array
        Minus the entropy of each q(w_k).
    beta : float
        Mean of the noise precision.
    rho : (D,) array
        Shares of the kernel prior.

    """

    f: Image
    f_var: Image
    w: Vector
    w_var: Vector
    w_entropy: Vector
    beta: float
    rho: Vector


def start(f: Image, w: ArrayLike, *, f_var: float = 1e-4, w_var: float = 1e-8) -> Posterior:
    """Return the first posterior of a scale: given means of small variance."""
    mean = np.asarray(w, np.float64)
    entropy = np.full(mean.shape, -0.5 * log(2 * pi * np.e * w_var))
    return Posterior(
        f.astype(np.float32),
        np.full(f.shape, f_var, np.float32),
        mean,
        np.full(mean.shape, w_var),
        entropy,
        1.0,
        KERNEL_PRIOR.rho,
    )


def rectified_moments(x1: float, x2: float) -> tuple[float, float, float]:
    """Mean, second moment and minus entropy of ``q(w) ~ exp(-x2 w^2/2 + x1 w)``, w >= 0.

    With ``t = -x1 / sqrt(2 x2)``; far in the tails (|t| > 25) by asymptotic series.
    """
    t = -x1 / sqrt(2 * x2)
    if t > _FAR:
        y = -x1
        s = x2 / (y * y)
        mean = (1 - 2 * s + 10 * s * s) / y
        second = (2 - 10 * s + 74 * s * s) / (y * y)
        return mean, second, log(y) - 1 + 2 * s - 7.5 * s * s
    if t < -_FAR:
        mean = x1 / x2
        return mean, mean * mean + 1 / x2, -0.5 * log(2 * pi * exp(1) / x2)
    tail = float(erfcx(t))
    mean = x1 / x2 + sqrt(2 / (pi * x2)) / tail
    second = x1 * mean / x2 + 1 / x2
    log_z = log(sqrt(pi / (2 * x2)) * tail)
    return mean, second, -x2 * second / 2 + x1 * mean - log_z


def gradient_precision(second: Image, prior: GaussianMixture) -> tuple[Image, float]:
    """Expected prior precision of each gradient, and the prior's part of C_KL.

    The responsibilities are ``lam_ja ~ pi_a sqrt(gamma_a) exp(-gamma_a <f_j^2> / 2)``. The results
    are ``Gam_j = sum_a lam_ja gamma_a`` and
    ``sum_ja lam_ja [ln lam_ja - ln pi_a - ln(gamma_a / 2 pi) / 2 + gamma_a <f_j^2> / 2]``.
    """
    gamma = prior.gamma.astype(np.float32)
    level = np.log(prior.pi * np.sqrt(prior.gamma / (2 * pi))).astype(np.float32)
    top = np.full(second.shape, -np.inf, np.float32)
    for a in range(len(gamma)):
        np.maximum(top, level[a] - gamma[a] / 2 * second, out=top)
    total = np.zeros_like(second)
    weighted = np.zeros_like(second)
    for a in range(len(gamma)):
        part = np.exp(level[a] - gamma[a] / 2 * second - top)
        total += part
        weighted += gamma[a] * part
    bound = -float((np.log(total) + top).sum(dtype=np.float64))
    weighted /= total
    return weighted, bound


def weight_rate(w: Vector, prior: ExponentialMixture) -> tuple[Vector, Vector, float]:
    """Expected prior rate of each weight, new shares, and the prior's part of C_KL.

    ``kap_kd ~ rho_d r_d exp(-r_d W_k)``, ``R_k = sum_d kap_kd r_d``, ``rho_d ~ 1 + sum_k kap_kd``.
    """
    log_part = np.log(prior.rho * prior.rate) - w[:, None] * prior.rate
    top = log_part.max(1, keepdims=True)
    part = np.exp(log_part - top)
    total = part.sum(1, keepdims=True)
    kappa = part / total
    shares = 1 + kappa.sum(0)
    bound = -float((np.log(total) + top).sum())
    return kappa @ prior.rate, shares / shares.sum(), bound
