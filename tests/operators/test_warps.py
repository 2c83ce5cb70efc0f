from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.rotations import displacements, homographies
from deshake.operators import warps
from deshake.operators.warps import Warps

if TYPE_CHECKING:
    from collections.abc import Callable


def dense(camera: Camera, theta: np.ndarray, margin: int) -> np.ndarray:
    """``C_ijk`` from its definition, (observed, latent, K)."""
    height, width = camera.height + 2 * margin, camera.width + 2 * margin
    points = [(x, y) for y in range(camera.height) for x in range(camera.width)]
    places = displacements(homographies(camera, theta), points) + np.array(points)[:, None] + margin
    c = np.zeros((len(points), height, width, len(theta)))
    for i, k in itertools.product(range(len(points)), range(len(theta))):
        x, y = places[i, k]
        x0, y0 = int(np.floor(x)), int(np.floor(y))
        for column, row in itertools.product((x0, x0 + 1), (y0, y0 + 1)):
            if 0 <= column < width and 0 <= row < height:
                c[i, row, column, k] = (1 - abs(x - column)) * (1 - abs(y - row))
    return c.reshape(len(points), -1, len(theta))


@pytest.mark.parametrize("margin", [0, 4])
def test_maps_are_sums_over_bilinear_weights(margin: int) -> None:
    camera = Camera.from_focal(12.0, 7, 9)
    rng = np.random.default_rng(0)
    theta = rng.normal(size=(4, 3)) * 0.1
    w = rng.random(4)
    c = dense(camera, theta, margin)
    blur = Warps(camera, theta, margin=margin)
    f = rng.random(blur.latent_shape).astype(np.float32)
    r = rng.random(camera.shape).astype(np.float32)
    mask = rng.random(camera.shape).astype(np.float32)
    a, b = c @ w, np.einsum("ijk,j->ik", c, f.ravel())
    np.testing.assert_allclose(blur.blur(f, w).ravel(), a @ f.ravel(), atol=1e-5)
    np.testing.assert_allclose(blur.adjoint(r, w).ravel(), a.T @ r.ravel(), atol=1e-5)
    np.testing.assert_allclose(blur.kernel_adjoint(f, r), b.T @ r.ravel(), rtol=1e-5)
    np.testing.assert_allclose(blur.gram(f), b.T @ b, rtol=1e-5)
    np.testing.assert_allclose(blur.gram(f, mask), b.T @ (mask.ravel()[:, None] * b), rtol=1e-5)


def test_adjoint_is_not_the_inverse_warp(dot_test: Callable[..., float], camera: Camera) -> None:
    one, turn = np.ones(1), np.array([[0.01, 0.02, 0.12]])
    there, back = Warps(camera, turn, margin=0), Warps(camera, -turn, margin=0)
    sizes = camera.shape, camera.shape
    assert dot_test(lambda f: there.blur(f, one), lambda g: there.adjoint(g, one), *sizes) <= 1e-5
    assert dot_test(lambda f: there.blur(f, one), lambda g: back.blur(g, one), *sizes) > 1e-3
    # yet both put a smooth picture in the same place
    y, x = np.mgrid[0 : camera.height, 0 : camera.width]
    smooth = (np.sin(x / 9) + np.cos(y / 8)).astype(np.float32)
    inside = (slice(20, -20), slice(20, -20))
    gap = there.adjoint(smooth, one)[inside] - back.blur(smooth, one)[inside]
    assert np.sqrt((gap**2).mean()) < 0.03
    assert np.sqrt(((smooth[inside] - back.blur(smooth, one)[inside]) ** 2).mean()) > 0.1


@pytest.mark.parametrize("channels", [(), (3,)])
def test_gram_is_made_of_unit_kernels(
    camera: Camera, theta: np.ndarray, channels: tuple[int, ...]
) -> None:
    blur = Warps(camera, theta)
    rng = np.random.default_rng(0)
    f = rng.random((*blur.latent_shape, *channels)).astype(np.float32)
    mask = (rng.random(camera.shape) > 0.3).astype(np.float32)
    columns = np.stack([blur.blur(f, unit) for unit in np.eye(len(theta))], -1)
    columns = columns.reshape(*camera.shape, -1, len(theta)).astype(np.float64)
    expected = np.einsum("hwck,hwcl->kl", columns, columns)
    np.testing.assert_allclose(blur.gram(f), expected, rtol=1e-6)
    expected = np.einsum("hw,hwck,hwcl->kl", mask, columns, columns)
    np.testing.assert_allclose(blur.gram(f, mask), expected, rtol=1e-6)


def test_tiles_do_not_show(
    camera: Camera, theta: np.ndarray, weights: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    blur = Warps(camera, theta)
    f = np.random.default_rng(0).random(blur.latent_shape).astype(np.float32)
    g = np.random.default_rng(1).random(camera.shape).astype(np.float32)
    whole = blur.blur(f, weights), blur.adjoint(g, weights)
    monkeypatch.setattr(warps, "_TILE", 16)
    np.testing.assert_allclose(blur.blur(f, weights), whole[0], atol=1e-5)
    np.testing.assert_allclose(blur.adjoint(g, weights), whole[1], atol=1e-5)


def test_coordinates_stay_exact_far_from_the_origin() -> None:
    """A ramp shows the place where it is sampled."""
    camera = Camera.from_focal(12000.0, 4, 12000)
    blur = Warps(camera, [[0.0, 3.37 / 12000, 0.0]])
    ramp = np.arange(blur.latent_shape[1], dtype=np.float64) - blur.margin - 11900
    f = np.tile(ramp.astype(np.float32), (blur.latent_shape[0], 1))
    points = np.array([[x, 1.0] for x in range(11800, 12000)])
    expected = points + displacements(homographies(camera, blur.theta), points)[:, 0]
    blurred = blur.blur(f, [1.0])[1, 11800:]
    np.testing.assert_allclose(blurred, expected[:, 0] - 11900, atol=2e-4)


def test_colours_are_warped_alike(camera: Camera, theta: np.ndarray, weights: np.ndarray) -> None:
    """OpenCV rounds coordinates for some numbers of channels; none of them is used."""
    blur = Warps(camera, theta)
    f = np.random.default_rng(0).random((*blur.latent_shape, 6)).astype(np.float32)
    planes = np.stack([blur.blur(f[..., c], weights) for c in range(6)], -1)
    for count in range(1, 7):
        some = blur.blur(f[..., :count], weights)
        np.testing.assert_allclose(some, planes[..., :count], atol=1e-6)


def test_wrong_input_is_refused(camera: Camera, theta: np.ndarray, weights: np.ndarray) -> None:
    blur = Warps(camera, theta)
    latent = np.zeros(blur.latent_shape, np.float32)
    observed = np.zeros(camera.shape, np.float32)
    for wrong in (
        lambda: blur.blur(observed, weights),
        lambda: blur.adjoint(latent, weights),
        lambda: blur.kernel_adjoint(observed, observed),
        lambda: blur.kernel_adjoint(latent, latent),
        lambda: blur.gram(observed),
        lambda: blur.blur(latent, weights[:-1]),
        lambda: blur.adjoint(observed, np.ones((7, 1))),
        lambda: Warps(camera, np.zeros(3)),
        lambda: Warps(camera, np.zeros((0, 3))),
        lambda: Warps(camera, np.full((2, 3), np.nan)),
    ):
        with pytest.raises(ValueError, match=r"fit|rotations are"):
            wrong()
