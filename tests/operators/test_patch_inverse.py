from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.operators.filter_flow import FilterFlow
from deshake.operators.patch_inverse import PatchInverse

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.geometry.camera import Camera


@pytest.fixture(scope="module")
def blur(camera: Camera, theta: np.ndarray, weights: np.ndarray):
    return FilterFlow(camera, theta, threads=2).filters(weights)


@pytest.mark.parametrize(("rho", "alpha"), [(0.01, 0), (1.0, 0), (0.1, 0.3)])
def test_is_symmetric_and_positive(
    blur, rho: float, alpha: float, dot_test: Callable[..., float]
) -> None:
    inverse = PatchInverse(blur)
    shape = (2, *blur.grid.latent_shape)

    def apply(x):
        return inverse.apply(x, rho, alpha)

    assert dot_test(apply, apply, shape, shape) <= 1e-5
    for seed in range(3):
        x = np.random.default_rng(seed).normal(size=shape).astype(np.float32)
        assert np.vdot(x, apply(x)) > 0


def smoothed(f: np.ndarray, blur, rho: float, alpha: float) -> np.ndarray:
    """Apply A' A + rho D' D + alpha."""
    out = blur.adjoint(blur.forward(f)) + np.float32(alpha) * f
    for axis in (1, 2):
        slopes = np.diff(f, axis=axis)
        before, after = [(0, 0)] * 3, [(0, 0)] * 3
        before[axis], after[axis] = (1, 0), (0, 1)
        out += np.float32(rho) * (np.pad(slopes, before) - np.pad(slopes, after))
    return out


@pytest.mark.parametrize(("rho", "alpha"), [(0.03, 0), (0.3, 0), (0.03, 0.1)])
def test_a_step_with_it_goes_far(blur, rho: float, alpha: float) -> None:
    rng = np.random.default_rng(4)
    truth = rng.normal(size=(1, *blur.grid.latent_shape)).astype(np.float32).cumsum(2)
    truth -= truth.mean()
    target = smoothed(truth, blur, rho, alpha)

    def rest(direction: np.ndarray) -> float:
        """Energy that is left after one exact step from nothing, of all there was."""
        power = np.vdot(direction, smoothed(direction, blur, rho, alpha))
        return 1 - np.vdot(direction, target) ** 2 / power / np.vdot(truth, target)

    assert rest(PatchInverse(blur).apply(target, rho, alpha)) < 0.6 * rest(target)


def test_threads_do_not_change_a_byte(camera: Camera, theta, weights) -> None:
    f = np.random.default_rng(1).random((3, *FilterFlow(camera, theta).latent_shape), np.float32)
    found = {
        PatchInverse(FilterFlow(camera, theta, threads=t).filters(weights)).apply(f, 0.1).tobytes()
        for t in (1, 3)
    }
    assert len(found) == 1


def test_refuses_another_size(blur) -> None:
    with pytest.raises(ValueError, match="does not fit"):
        PatchInverse(blur).apply(np.zeros((1, 9, 9), np.float32), 0.1)
