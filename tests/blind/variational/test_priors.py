from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from deshake.blind.variational import priors


@pytest.mark.parametrize("level", range(8))
def test_gradient_mixtures_are_densities(level: int) -> None:
    prior = priors.gradients(level)

    def density(f: float) -> float:
        parts = prior.pi * np.sqrt(prior.gamma / (2 * np.pi)) * np.exp(-prior.gamma * f * f / 2)
        return float(parts.sum())

    assert np.all(prior.gamma > 0)
    reach = 8 / np.sqrt(prior.gamma.min())
    half, _ = quad(density, 0, reach, points=2 / np.sqrt(prior.gamma), limit=200)
    assert 2 * half == pytest.approx(1, abs=1e-6)


def test_coarser_gradients_are_those_of_the_coarsest_mixture() -> None:
    assert priors.gradients(7) is priors.gradients(8) is priors.gradients(100)
    assert len({id(priors.gradients(level)) for level in range(20)}) == 8


def test_gradients_are_sparse_at_every_scale() -> None:
    for level in range(8):
        prior = priors.gradients(level)
        variance = (prior.pi / prior.gamma).sum()
        kurtosis = 3 * (prior.pi / prior.gamma**2).sum() / variance**2
        assert kurtosis > 6


def test_the_kernels_mixture_is_a_density_over_weights() -> None:
    prior = priors.KERNEL_PRIOR
    assert prior.rho.sum() == pytest.approx(1)
    assert np.all(prior.rho > 0)
    assert np.all(prior.rate > 0)
    assert prior.rho.shape == prior.rate.shape
