from __future__ import annotations

import numpy as np
import pytest

from deshake.simulation.exposure import expose


@pytest.mark.parametrize("level", [0.1, 0.5])
def test_noise_is_as_strong_as_asked(level):
    pixels = np.full((400, 500), level, np.float32)
    expose(pixels, photons=2000, noise_sigma=0.005, seed=1)
    assert pixels.mean() == pytest.approx(level, abs=1e-3)
    assert pixels.std() == pytest.approx(np.sqrt(level / 2000 + 0.005**2), rel=0.02)


def test_gain_and_clipping_without_noise():
    pixels = np.float32([[-0.1, 0.2, 0.6]])
    expose(pixels, gain=2)
    np.testing.assert_allclose(pixels, [[0, 0.4, 1]])
