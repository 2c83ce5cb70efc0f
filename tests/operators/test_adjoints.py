"""The adjoints of both kinds of operator, by dot tests: ``<A x, y> = <x, A' y>``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.operators.filter_flow import FilterFlow
from deshake.operators.warps import Warps

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.geometry.camera import Camera

pytestmark = [
    pytest.mark.parametrize("kind", [FilterFlow, Warps]),
    pytest.mark.parametrize("margin", [None, 0, 14]),
    pytest.mark.parametrize("channels", [(), (3,), (5,)]),
]


def test_dot_test_in_the_image(
    *,
    dot_test: Callable[..., float],
    camera: Camera,
    theta: np.ndarray,
    weights: np.ndarray,
    kind: type,
    margin: int | None,
    channels: tuple[int, ...],
) -> None:
    blur = kind(camera, theta, margin=margin)
    error = dot_test(
        lambda f: blur.blur(f, weights),
        lambda g: blur.adjoint(g, weights),
        (*blur.latent_shape, *channels),
        (*camera.shape, *channels),
    )
    assert error <= 1e-5


def test_dot_test_in_the_kernel(
    *,
    dot_test: Callable[..., float],
    camera: Camera,
    theta: np.ndarray,
    kind: type,
    margin: int | None,
    channels: tuple[int, ...],
) -> None:
    blur = kind(camera, theta, margin=margin)
    f = np.random.default_rng(3).random((*blur.latent_shape, *channels)).astype(np.float32)
    error = dot_test(
        lambda w: blur.blur(f, w),
        lambda r: blur.kernel_adjoint(f, r),
        (len(theta),),
        (*camera.shape, *channels),
    )
    assert error <= 1e-5
