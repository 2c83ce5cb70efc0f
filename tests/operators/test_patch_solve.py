from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.filter_flow import reach
from deshake.operators.patch_solve import PatchFrame, PatchSolver, gather, patch_size
from deshake.operators.warps import Warps

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float32]

MARGIN = 16
CAMERA = Camera.from_focal(160.0, 120, 152)
PATCHES = (None, 48)


def kernel_of(camera: Camera, seed: int = 0) -> RotationKernel:
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(size=(6, 3)), 0) * 2 * grid_steps(camera)
    if camera.is_uniform:
        path[:, 2] = 0
    return RotationKernel.from_path(path, camera).centred()


def frame_of(camera: Camera, kernel: RotationKernel, patch: int | None, threads: int = 1):
    room = reach(camera, kernel.theta) + 4
    return PatchFrame(camera, margin=MARGIN, room=room, patch=patch, threads=threads)


@pytest.fixture(scope="module")
def picture(photo: Array) -> Array:
    """Cut out a piece of the photo of the camera's size with its margin, fading to zero."""
    high, wide = CAMERA.height + 2 * MARGIN, CAMERA.width + 2 * MARGIN
    piece = photo[100 : 100 + high, 150 : 150 + wide]
    fade = np.ones(piece.shape, np.float32)
    ramp = np.sin(np.linspace(0, np.pi / 2, MARGIN)) ** 2
    for turned in (fade, fade[::-1], fade.T, fade.T[::-1]):
        turned[:MARGIN] *= ramp[:, None]
    return ((piece - piece.mean()) * fade).astype(np.float32)


@pytest.mark.parametrize("patch", PATCHES)
def test_windows_sum_to_one(picture: Array, patch: int | None) -> None:
    frame = frame_of(CAMERA, kernel_of(CAMERA), patch)
    again = frame.assembled(lambda strip: frame.windowed(picture, strip))
    np.testing.assert_allclose(again, picture, atol=1e-6)


def test_blurs_like_exact_warps(picture: Array) -> None:
    kernel = kernel_of(CAMERA)
    solver = PatchSolver(frame_of(CAMERA, kernel, 48), kernel.theta, kernel.weights)
    seen = solver.forward(picture)[MARGIN:-MARGIN, MARGIN:-MARGIN]
    exact = Warps(CAMERA, kernel.theta, margin=MARGIN).blur(picture, kernel.weights)
    assert np.sqrt(np.mean((seen - exact) ** 2)) < 2e-3


def test_one_patch_is_uniform_blur_exactly(picture: Array) -> None:
    camera = Camera.uniform(*CAMERA.shape)
    kernel = kernel_of(camera)
    assert patch_size(camera, kernel.theta) is None
    solver = PatchSolver(frame_of(camera, kernel, None), kernel.theta, kernel.weights)
    seen = solver.forward(picture)[MARGIN:-MARGIN, MARGIN:-MARGIN]
    exact = Warps(camera, kernel.theta, margin=MARGIN).blur(picture, kernel.weights)
    np.testing.assert_allclose(seen, exact, atol=2e-5)


@pytest.mark.parametrize("patch", PATCHES)
def test_solve_returns_what_was_blurred(picture: Array, patch: int | None) -> None:
    camera = CAMERA if patch else Camera.uniform(*CAMERA.shape)
    kernel = kernel_of(camera)
    solver = PatchSolver(frame_of(camera, kernel, patch), kernel.theta, kernel.weights)
    g = solver.forward(picture)
    right, down = np.roll(picture, -1, 1) - picture, np.roll(picture, -1, 0) - picture
    solved = solver.solve(solver.data(g), right, down, 0.05)
    error = np.sqrt(np.mean((solved - picture) ** 2))
    assert error < 0.15 * np.sqrt(np.mean((g - picture) ** 2))


def test_solve_without_gradients_smooths(picture: Array) -> None:
    kernel = RotationKernel.delta(CAMERA)
    solver = PatchSolver(frame_of(CAMERA, kernel, 48), kernel.theta, kernel.weights)
    none = np.zeros_like(picture)
    data = solver.data(picture)
    slopes = [np.abs(np.diff(solver.solve(data, none, none, beta))).mean() for beta in (0.1, 1, 10)]
    assert slopes[0] > 1.2 * slopes[1] > 1.44 * slopes[2]


@pytest.mark.parametrize("patch", PATCHES)
def test_threads_change_no_byte(picture: Array, patch: int | None) -> None:
    kernel = kernel_of(CAMERA)
    results = []
    for threads in (1, 3):
        frame = frame_of(CAMERA, kernel, patch, threads)
        solver = PatchSolver(frame, kernel.theta, kernel.weights)
        solved = solver.solve(solver.data(picture), picture, picture, 0.1)
        results.append((solver.forward(picture).tobytes(), solved.tobytes()))
    assert results[0] == results[1]


def test_patches_shrink_as_the_camera_rolls() -> None:
    steps = grid_steps(CAMERA)
    wide = Camera.from_focal(1000.0, 900, 1200)
    still = patch_size(wide, np.zeros((1, 3)))
    rolled = patch_size(wide, np.array([[0, 0, 0.0], [0, 0, 0.05]]))
    assert still == 256
    assert rolled == 60
    assert patch_size(CAMERA, np.array([[0, 0, 0], 90 * steps])) == 48


def test_gather_is_bilinear_and_periodic() -> None:
    block = np.arange(30, dtype=np.float32).reshape(1, 5, 6)
    lags = np.array([[[2.0, 1.0], [0.5, 0.0], [-1.0, -1.0], [0.0, 2.25]]])
    np.testing.assert_allclose(gather(block, lags), [8, 0.5, 29, 13.5])
