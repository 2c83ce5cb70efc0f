from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy.fft

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.convolution import Convolution
from deshake.operators.filter_flow import FilterFlow
from deshake.operators.patch_inverse import FourierInverse, PatchInverse, approximate_inverse
from deshake.operators.shake_blur import blur_filters
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable

KINDS = {"rotations": PatchInverse, "uniform": FourierInverse}


def filters(name: str, camera: Camera, theta: np.ndarray, weights: np.ndarray, threads: int = 2):
    """Make the filters of rotations, or of uniform blur with as many pixels."""
    if name == "uniform":
        long = Camera.uniform(*camera.shape)
        theta = theta * (1, 1, 0) * camera.focal_px / long.focal_px
        camera = long
    return blur_filters(
        RotationKernel(theta, weights, grid_steps(camera), camera), run=Run(threads)
    )


@pytest.fixture(scope="module", params=list(KINDS))
def blur(request, camera: Camera, theta: np.ndarray, weights: np.ndarray):
    return filters(request.param, camera, theta, weights)


def latent(blur) -> tuple[int, int]:
    return blur.latent_shape if isinstance(blur, Convolution) else blur.grid.latent_shape


def test_each_blur_has_its_inverse(camera: Camera, theta, weights) -> None:
    for name, kind in KINDS.items():
        flow = filters(name, camera, theta, weights)
        inverse = approximate_inverse(flow)
        assert isinstance(inverse, kind)
        assert inverse.filters is flow


@pytest.mark.parametrize(("rho", "alpha"), [(0.01, 0), (1.0, 0), (0.1, 0.3)])
def test_is_linear_and_positive(blur, rho: float, alpha: float) -> None:
    inverse = approximate_inverse(blur)
    images = np.random.default_rng(3).normal(size=(3, 2, *latent(blur))).astype(np.float32)
    x, y, _ = images

    def apply(image):
        return inverse.apply(image, rho, alpha)

    both = apply(2 * x - y)
    np.testing.assert_allclose(both, 2 * apply(x) - apply(y), atol=1e-5 * np.abs(both).max())
    for image in images:
        assert np.vdot(image, apply(image)) > 0


@pytest.mark.parametrize(("rho", "alpha"), [(0.01, 0), (1.0, 0), (0.1, 0.3)])
def test_of_one_filter_is_symmetric(
    rho: float, alpha: float, dot_test: Callable[..., float]
) -> None:
    long = Camera.uniform(75, 101)
    path = np.array([(0, 0, 0), (3, 6, 0)]) * grid_steps(long)
    blur = blur_filters(RotationKernel.from_path(path, long))
    assert isinstance(blur, Convolution)
    inverse = FourierInverse(blur)
    shape = (2, *blur.latent_shape)

    def apply(image):
        return inverse.apply(image, rho, alpha)

    assert dot_test(apply, apply, shape, shape) <= 1e-5


@pytest.mark.parametrize("rough", [False, True])
def test_patches_do_what_one_filter_does_where_the_blur_hardly_changes(rough) -> None:
    long = Camera.uniform(150, 210)
    path = np.array([(0, 0, 0), (2, 5, 0), (6, 7, 0)]) * grid_steps(long)
    kernel = RotationKernel.from_path(path, long).centred()
    one = blur_filters(kernel)
    assert isinstance(one, Convolution)
    flow = FilterFlow(long, kernel.theta, margin=one.margin, hop=40, rough=rough)
    patches = flow.filters(kernel.weights)
    f = np.zeros((1, *one.latent_shape), np.float32)
    f[:, 30:-30, 30:-30] = np.random.default_rng(7).normal(size=f[:, 30:-30, 30:-30].shape)
    exact = FourierInverse(one).apply(f, 0.05, 0.01)
    near = PatchInverse(patches).apply(f, 0.05, 0.01)
    assert np.linalg.norm(near - exact) < 0.04 * np.linalg.norm(exact)


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
    truth = rng.normal(size=(1, *latent(blur))).astype(np.float32).cumsum(2)
    truth -= truth.mean()
    target = smoothed(truth, blur, rho, alpha)

    def rest(direction: np.ndarray) -> float:
        """Energy that is left after one exact step from nothing, of all there was."""
        power = np.vdot(direction, smoothed(direction, blur, rho, alpha))
        return 1 - np.vdot(direction, target) ** 2 / power / np.vdot(truth, target)

    assert rest(approximate_inverse(blur).apply(target, rho, alpha)) < 0.6 * rest(target)


def test_every_plane_has_its_weight(blur) -> None:
    f = np.random.default_rng(1).random((3, *latent(blur)), np.float32)
    inverse = approximate_inverse(blur)
    together = inverse.apply(f, [0.1, 0.4, 0.1], 0.2)
    for plane, rho, result in zip(f, (0.1, 0.4, 0.1), together, strict=True):
        alone = inverse.apply(plane[None], rho, 0.2)[0]
        np.testing.assert_allclose(result, alone, atol=1e-5 * np.abs(alone).max())


def test_on_the_torus_it_is_the_inverse(camera: Camera, theta, weights) -> None:
    blur = filters("uniform", camera, theta, weights)
    inverse = FourierInverse(blur)
    rng = np.random.default_rng(3)
    bump = np.zeros(blur.torus, np.float32)
    bump[20:-20, 20:-20] = rng.normal(size=bump[20:-20, 20:-20].shape)
    power = np.abs(blur.spectrum) ** 2
    # M of the bump, by differences that wrap around
    M = scipy.fft.irfft2(scipy.fft.rfft2(bump) * power, blur.torus) + 0.3 * bump
    for axis in (0, 1):
        M += 0.5 * (2 * bump - np.roll(bump, 1, axis) - np.roll(bump, -1, axis))
    height, width = blur.latent_shape
    inside = np.zeros_like(M)
    inside[:height, :width] = M[:height, :width]
    np.testing.assert_allclose(inside, M, atol=1e-4)  # nothing of it lies beyond the latent image
    result = inverse.apply(inside[None, :height, :width].astype(np.float32), 0.5, 0.3)[0]
    np.testing.assert_allclose(result, bump[:height, :width], atol=5e-3)


@pytest.mark.parametrize("name", list(KINDS))
def test_threads_do_not_change_a_byte(name: str, camera: Camera, theta, weights) -> None:
    blurs = [filters(name, camera, theta, weights, threads) for threads in (1, 3)]
    f = np.random.default_rng(1).random((3, *latent(blurs[0])), np.float32)
    assert len({approximate_inverse(blur).apply(f, 0.1).tobytes() for blur in blurs}) == 1


def test_refuses_another_size(blur) -> None:
    with pytest.raises(ValueError, match="does not fit"):
        approximate_inverse(blur).apply(np.zeros((1, 9, 9), np.float32), 0.1)


@pytest.mark.parametrize("name", list(KINDS))
def test_even_means_are_one_weight(name: str, camera: Camera, theta, weights) -> None:
    blur = filters(name, camera, theta, weights)
    inverse = approximate_inverse(blur)
    even = inverse.means(np.full(camera.shape, 0.3, np.float32))
    np.testing.assert_allclose(even, 0.3, rtol=1e-6)
    x = np.random.default_rng(4).normal(size=(1, *latent(blur))).astype(np.float32)
    np.testing.assert_allclose(
        inverse.apply(x, 0.1, even), inverse.apply(x, 0.1, 0.3), rtol=1e-4, atol=1e-5
    )


def test_every_patch_may_have_its_weight(camera: Camera, theta, weights) -> None:
    flow = FilterFlow(camera, theta, hop=30, rough=True).filters(weights)
    grid, inverse = flow.grid, PatchInverse(flow)
    rng = np.random.default_rng(4)
    uneven = inverse.means((rng.random(camera.shape) ** 8).astype(np.float32))
    assert 0 < uneven.min() < uneven.max()
    x = rng.normal(size=(1, *grid.latent_shape)).astype(np.float32)
    result = inverse.apply(x, 0.1, uneven)
    for row, column in [(1, 1), (2, 3)]:  # the middle of a patch is its own
        y, o = (at * grid.hop - grid.ramp + grid.patch // 2 + grid.margin for at in (row, column))
        alone = inverse.apply(x, 0.1, uneven[row, column])
        assert result[0, y, o] == pytest.approx(alone[0, y, o], rel=1e-4)
        assert result[0, y, o] != pytest.approx(inverse.apply(x, 0.1)[0, y, o], rel=1e-4)


@pytest.mark.parametrize("rough", [False, True])
def test_means_are_those_of_the_patches(rough, camera: Camera, theta, weights) -> None:
    flow = FilterFlow(camera, theta, rough=rough).filters(weights)
    image = np.random.default_rng(5).random(camera.shape).astype(np.float32)
    means = PatchInverse(flow).means(image)
    grid = flow.grid
    assert means.shape == (grid.rows, grid.columns)
    for row in range(grid.rows):
        for column in range(grid.columns):
            top, left = row * grid.hop - grid.ramp, column * grid.hop - grid.ramp
            part = image[max(top, 0) : top + grid.patch, max(left, 0) : left + grid.patch]
            np.testing.assert_allclose(means[row, column], part.mean(), rtol=1e-5)
