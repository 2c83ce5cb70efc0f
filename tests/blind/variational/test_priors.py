from __future__ import annotations

import numpy as np
import pytest

from deshake.blind.variational import priors


@pytest.mark.parametrize("level", range(8))
def test_gradient_mixtures_are_densities(level: int) -> None:
    prior = priors.gradients(level)
    assert prior.pi.sum() == pytest.approx(1, abs=1e-6)
    assert np.all(prior.pi > 0)
    assert np.all(prior.gamma > 0)


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
