from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy.signal

from deshake.geometry.camera import Camera
from deshake.operators.convolution import Convolution
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.warps import Warps
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable

CAMERA = Camera.uniform(150, 201)
SHAPES = [(40, 57), (61, 48), (5, 300)]


def noise(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


@pytest.fixture(scope="module")
def theta() -> np.ndarray:
    """Rotations that shift the frame by up to nine pixels."""
    shifts = np.random.default_rng(0).uniform(-9, 9, (12, 2))
    return np.stack([-shifts[:, 1], shifts[:, 0], np.zeros(12)], 1) / CAMERA.focal_px


@pytest.fixture(scope="module")
def weights() -> np.ndarray:
    weights = np.random.default_rng(2).random(12)
    return weights / weights.sum()


@pytest.fixture(scope="module")
def splat(theta: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Filter of the frame: that of a patch."""
    filters = FilterFlow(CAMERA, theta, run=Run(1)).filters(weights)
    return filters.filters(filters.grid.strips[0])[0]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("radius", [0, 1, 6])
@pytest.mark.parametrize("margin", [0, 2, 6, 15])
def test_dot_test(
    *,
    dot_test: Callable[..., float],
    shape: tuple[int, int],
    channels: int,
    radius: int,
    margin: int,
) -> None:
    blur = Convolution(noise(2 * radius + 1, 2 * radius + 1), shape, margin, run=Run(2))
    latent, observed = (channels, *blur.latent_shape), (channels, *shape)
    assert dot_test(blur.forward, blur.adjoint, latent, observed) <= 1e-5


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("margin", [0, 2, 6, 15])
def test_is_a_correlation_with_zeros_around(shape: tuple[int, int], margin: int) -> None:
    h = noise(13, 13)
    blur = Convolution(h, shape, margin, run=Run(1))
    f, g = noise(*blur.latent_shape, seed=1), noise(*shape, seed=2)
    correlated = scipy.signal.correlate(np.pad(f, 6), h, "valid", "direct")
    correlated = correlated[margin : margin + shape[0], margin : margin + shape[1]]
    np.testing.assert_allclose(blur.forward(f[None])[0], correlated, atol=5e-5)
    back = scipy.signal.convolve(np.pad(g, margin), h, "same", "direct")
    np.testing.assert_allclose(blur.adjoint(g[None])[0], back, atol=5e-5)


def test_is_linear_and_takes_channels_one_by_one() -> None:
    blur = Convolution(noise(9, 9), (40, 57), 4, run=Run(2))
    f = noise(3, *blur.latent_shape)
    together = blur.forward(f)
    for plane, blurred in zip(f, together, strict=True):
        np.testing.assert_array_equal(blur.forward(plane[None])[0], blurred)
    mixed = blur.forward(f[:1] + 2 * f[1:2])
    np.testing.assert_allclose(mixed, together[:1] + 2 * together[1:2], atol=1e-4)
    g = noise(2, 40, 57)
    back = blur.adjoint(g)
    np.testing.assert_allclose(blur.adjoint(g[:1] - 3 * g[1:]), back[:1] - 3 * back[1:], atol=1e-4)


def test_a_filter_of_one_pixel_changes_nothing() -> None:
    f = noise(1, 44, 61)
    blur = Convolution(np.ones((1, 1), np.float32), (40, 57), 2)
    np.testing.assert_allclose(blur.forward(f), f[:, 2:-2, 2:-2], atol=1e-6)


@pytest.mark.parametrize("margin", [0, 5, 25])
def test_does_what_patches_and_warps_do(
    photo: np.ndarray, theta: np.ndarray, weights: np.ndarray, splat: np.ndarray, margin: int
) -> None:
    blur = Convolution(splat, CAMERA.shape, margin, run=Run(2))
    flow = FilterFlow(CAMERA, theta, margin=margin, run=Run(2))
    warps = Warps(CAMERA, theta, margin=margin)
    assert blur.latent_shape == flow.latent_shape == warps.latent_shape
    height, width = blur.latent_shape
    f = np.ascontiguousarray(photo[200 : 200 + height, 300 : 300 + width])
    g = np.ascontiguousarray(photo[:150, :201])
    for other, atol in ((flow, 1e-6), (warps, 2e-5)):
        np.testing.assert_allclose(blur.forward(f[None])[0], other.blur(f, weights), atol=atol)
        np.testing.assert_allclose(blur.adjoint(g[None])[0], other.adjoint(g, weights), atol=atol)


def test_threads_do_not_change_a_byte(splat: np.ndarray) -> None:
    f, g = noise(3, 150 + 20, 201 + 20), noise(3, 150, 201)
    blurs = [Convolution(splat, CAMERA.shape, 10, run=Run(n)) for n in (1, 2, 3)]
    assert len({blur.forward(f).tobytes() + blur.adjoint(g).tobytes() for blur in blurs}) == 1


def test_input_is_left_alone(splat: np.ndarray) -> None:
    blur = Convolution(splat, CAMERA.shape, 10)
    f, g = noise(1, *blur.latent_shape), noise(1, *CAMERA.shape)
    before = f.copy(), g.copy()
    once = blur.forward(f), blur.adjoint(g)
    np.testing.assert_array_equal(f, before[0])
    np.testing.assert_array_equal(g, before[1])
    np.testing.assert_array_equal(blur.forward(f), once[0])
    np.testing.assert_array_equal(blur.adjoint(g), once[1])


def test_refuses_other_sizes(splat: np.ndarray) -> None:
    blur = Convolution(splat, CAMERA.shape, 10)
    with pytest.raises(ValueError, match="does not fit"):
        blur.forward(np.zeros((1, *CAMERA.shape), np.float32))
    with pytest.raises(ValueError, match="does not fit"):
        blur.adjoint(np.zeros((1, *blur.latent_shape), np.float32))
    with pytest.raises(ValueError, match="does not fit"):
        blur.near(np.zeros(CAMERA.shape, bool))


def test_near_any_pixels_it_is_the_same_operator(splat: np.ndarray) -> None:
    blur = Convolution(splat, CAMERA.shape, 10)
    assert blur.near(np.zeros(blur.latent_shape, bool)) is blur
