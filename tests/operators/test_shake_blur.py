from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
import pytest
import scipy.signal

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import displacements, grid_steps, homographies
from deshake.operators.convolution import Convolution
from deshake.operators.local_filters import LocalFilters
from deshake.operators.shake_blur import ShakeBlur, blur_filters, observation_mask
from deshake.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable

Kind = Literal["filter_flow", "warps"]
KINDS: tuple[Kind, ...] = ("filter_flow", "warps")


@pytest.fixture
def kernel(camera: Camera, theta: np.ndarray, weights: np.ndarray) -> RotationKernel:
    some = weights.copy()
    some[2] = 0
    return RotationKernel(theta, some / some.sum(), grid_steps(camera), camera)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("channels", [(), (3,)])
@pytest.mark.parametrize("margin", [None, 0, 21])
@pytest.mark.parametrize("masked", [False, True])
def test_dot_test(
    *,
    dot_test: Callable[..., float],
    kernel: RotationKernel,
    kind: Kind,
    channels: tuple[int, ...],
    margin: int | None,
    masked: bool,
) -> None:
    mask = np.random.default_rng(0).random(kernel.camera.shape).astype(np.float32)
    mask[10:20, 10:30] = 0
    blur = ShakeBlur(kernel, margin=margin, mask=mask if masked else None, kind=kind, run=Run(2))
    error = dot_test(
        blur.forward,
        blur.adjoint,
        (*blur.latent_shape, *channels),
        (*blur.observed_shape, *channels),
    )
    assert error <= 1e-5


@pytest.mark.parametrize("kind", KINDS)
def test_masked_pixels_have_no_effect(kernel: RotationKernel, kind: Kind) -> None:
    mask = np.ones(kernel.camera.shape, np.float32)
    mask[:, :40] = 0
    blur = ShakeBlur(kernel, mask=mask, kind=kind)
    rng = np.random.default_rng(0)
    f = rng.random((*blur.latent_shape, 3)).astype(np.float32)
    whole = ShakeBlur(kernel, kind=kind).forward(f)
    np.testing.assert_array_equal(blur.forward(f), whole * mask[..., None])
    g = rng.random(kernel.camera.shape).astype(np.float32)
    changed = g + 5 * (1 - mask)
    np.testing.assert_array_equal(blur.adjoint(changed), blur.adjoint(g))


def test_kinds_agree(photo: np.ndarray, kernel: RotationKernel) -> None:
    blurs = [ShakeBlur(kernel, kind=kind) for kind in KINDS]
    assert blurs[0].latent_shape == blurs[1].latent_shape
    height, width = blurs[0].latent_shape
    f = np.ascontiguousarray(photo[100 : 100 + height, 300 : 300 + width])
    gap = blurs[0].forward(f) - blurs[1].forward(f)
    assert np.sqrt((gap**2).mean()) < 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_uniform_blur_is_a_convolution(photo: np.ndarray, kind: Kind) -> None:
    camera = Camera.uniform(150, 200)
    rng = np.random.default_rng(0)
    shifts = rng.uniform(-9, 9, (12, 2))  # px that each rotation moves the frame by
    theta = np.stack([-shifts[:, 1], shifts[:, 0], np.zeros(12)], 1) / camera.focal_px
    weights = rng.random(12)
    weights /= weights.sum()
    blur = ShakeBlur(RotationKernel(theta, weights, grid_steps(camera), camera), kind=kind)
    radius = blur.margin
    psf = np.zeros((2 * radius + 1, 2 * radius + 1))
    for (dx, dy), weight in zip(shifts, weights, strict=True):
        x, y = int(np.floor(dx)), int(np.floor(dy))
        a, b = dx - x, dy - y
        for column, across in ((x, 1 - a), (x + 1, a)):
            for row, down in ((y, 1 - b), (y + 1, b)):
                psf[radius + row, radius + column] += weight * across * down
    height, width = blur.latent_shape
    f = np.ascontiguousarray(photo[200 : 200 + height, 300 : 300 + width])
    expected = scipy.signal.correlate(f, psf, "valid", "fft")
    np.testing.assert_allclose(blur.forward(f), expected, atol=1e-5)
    g = np.ascontiguousarray(photo[:150, :200])
    expected = scipy.signal.convolve(g, psf, "full", "fft")
    np.testing.assert_allclose(blur.adjoint(g), expected, atol=1e-5)


def rolled(camera: Camera, roll: float) -> RotationKernel:
    """Make a kernel of five pixels' shift, and of a roll."""
    theta = np.zeros((6, 3))
    theta[:, 1] = np.linspace(-2.5, 2.5, 6) / camera.focal_px
    theta[:, 2] = np.linspace(-roll, roll, 6)
    return RotationKernel(theta, np.full(6, 1 / 6), grid_steps(camera), camera)


def test_the_frame_has_one_filter_where_that_is_enough() -> None:
    camera = Camera.uniform(90, 120)
    shifted = blur_filters(rolled(camera, 0.0), run=Run(1))
    assert isinstance(shifted, Convolution)
    assert shifted.margin == 4
    assert blur_filters(rolled(camera, 0.0), margin=9, run=Run(1)).latent_shape == (108, 138)
    assert isinstance(blur_filters(rolled(camera, 0.01), run=Run(1)), LocalFilters)
    assert isinstance(blur_filters(rolled(Camera.from_focal(150, 90, 120), 0.0)), LocalFilters)


def test_rotations_without_weight_do_not_count() -> None:
    camera = Camera.uniform(90, 120)
    kernel = rolled(camera, 0.0)
    theta = np.concatenate([kernel.theta, [[0, 0, 0.2]]])
    more = RotationKernel(theta, [*kernel.weights, 0.0], kernel.steps, camera)
    assert isinstance(blur_filters(more), Convolution)
    assert ShakeBlur(more).margin == ShakeBlur(kernel).margin


def test_delta_kernel_changes_nothing(photo: np.ndarray) -> None:
    camera = Camera.from_focal(200.0, 150, 200)
    blur = ShakeBlur(RotationKernel.delta(camera))
    f = np.ascontiguousarray(photo[:152, :202])
    assert blur.margin == 1
    np.testing.assert_allclose(blur.forward(f), f[1:-1, 1:-1], atol=1e-6)


def test_input_is_left_alone(kernel: RotationKernel) -> None:
    mask = np.full(kernel.camera.shape, 0.5, np.float32)
    blur = ShakeBlur(kernel, mask=mask)
    f = np.random.default_rng(0).random(blur.latent_shape).astype(np.float32)
    g = np.random.default_rng(1).random(blur.observed_shape).astype(np.float32)
    f_before, g_before = f.copy(), g.copy()
    blur.forward(f)
    blur.adjoint(g)
    np.testing.assert_array_equal(f, f_before)
    np.testing.assert_array_equal(g, g_before)
    assert np.all(mask == 0.5)


def test_wrong_sizes_are_refused(kernel: RotationKernel) -> None:
    for kind in KINDS:
        blur = ShakeBlur(kernel, kind=kind)
        with pytest.raises(ValueError, match="does not fit"):
            blur.forward(np.zeros(blur.observed_shape, np.float32))
        with pytest.raises(ValueError, match="does not fit"):
            blur.adjoint(np.zeros(blur.latent_shape, np.float32))


def test_observation_mask_marks_what_saw_only_the_frame(camera: Camera, theta: np.ndarray) -> None:
    mask = observation_mask(camera, theta)
    y, x = np.mgrid[0 : camera.height, 0 : camera.width]
    points = np.stack([x.ravel(), y.ravel()], 1).astype(np.float64)
    low, high = theta.min(0), theta.max(0)
    within = np.random.default_rng(0).uniform(low, high, (300, 3))
    every = np.concatenate([theta, within])
    moved = points[:, None] + displacements(homographies(camera, every), points)
    inside = np.all(
        (moved >= -0.01) & (moved <= [camera.width - 0.99, camera.height - 0.99]), (1, 2)
    )
    inside = inside.reshape(camera.shape)
    assert mask.dtype == np.float32
    assert not np.any((mask == 1) & ~inside)  # no rotation leads out, nor one between them
    assert mask.sum() > 0.8 * inside.sum()


def test_observation_mask_of_a_still_camera_is_full(camera: Camera) -> None:
    assert observation_mask(camera, np.zeros((1, 3))).all()
