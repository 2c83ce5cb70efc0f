from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from deshake.geometry.camera import Camera
from deshake.geometry.rotations import (
    angle_axis,
    compose,
    displacements,
    grid_steps,
    homographies,
    rotation_matrices,
)

CAMERA = Camera.from_focal(640.0, 480, 640)
ANGLES = arrays(np.float64, 3, elements=st.floats(-1.8, 1.8))
TINY = st.floats(1e-12, 1e-2)


@given(ANGLES, TINY)
def test_rotation_matrices_agree_with_scipy(theta: np.ndarray, scale: float) -> None:
    for angles in (theta, theta * scale):
        expected = Rotation.from_rotvec(angles).as_matrix()
        np.testing.assert_allclose(rotation_matrices(angles), expected, atol=1e-12)


def test_equation_3_has_the_paper_s_signs() -> None:
    eps = 1e-8
    turned = rotation_matrices(np.eye(3) * eps)
    x, y, z = (turned - np.eye(3)) / eps
    np.testing.assert_allclose(x, [[0, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-7)
    np.testing.assert_allclose(y, [[0, 0, 1], [0, 0, 0], [-1, 0, 0]], atol=1e-7)
    np.testing.assert_allclose(z, [[0, -1, 0], [1, 0, 0], [0, 0, 0]], atol=1e-7)


@given(ANGLES, TINY)
def test_angle_axis_undoes_rotation_matrices(theta: np.ndarray, scale: float) -> None:
    theta = theta * min(1.0, 3.1 / max(np.linalg.norm(theta), 1e-9))
    for angles in (theta, theta * scale):
        np.testing.assert_allclose(angle_axis(rotation_matrices(angles)), angles, atol=1e-10)


@pytest.mark.parametrize("short_of_pi", [1e-2, 1e-4, 1e-5, 1e-6])
def test_angle_axis_nearly_upside_down(short_of_pi: float) -> None:
    theta = np.array([0.6, 0.0, 0.8]) * (np.pi - short_of_pi)
    np.testing.assert_allclose(angle_axis(rotation_matrices(theta)), theta, atol=1e-8)


def test_rotations_of_many_angles_keep_their_shape() -> None:
    theta = np.random.default_rng(0).normal(size=(4, 5, 3))
    assert rotation_matrices(theta).shape == (4, 5, 3, 3)
    assert angle_axis(rotation_matrices(theta)).shape == (4, 5, 3)
    assert homographies(CAMERA, theta).shape == (4, 5, 3, 3)


@given(ANGLES, ANGLES)
def test_compose_turns_by_theta_first(delta: np.ndarray, theta: np.ndarray) -> None:
    expected = (Rotation.from_rotvec(delta) * Rotation.from_rotvec(theta)).as_matrix()
    np.testing.assert_allclose(rotation_matrices(compose(delta, theta)), expected, atol=1e-7)


def test_homographies_act_on_rays() -> None:
    theta = np.array([[0.02, -0.03, 0.05], [0.0, 0.0, 0.0]])
    h = homographies(CAMERA, theta)
    ray = np.array([0.1, -0.2, 1.0])
    pixel = CAMERA.matrix @ ray
    moved_pixel = h[0] @ pixel
    expected = CAMERA.matrix @ (Rotation.from_rotvec(theta[0]).as_matrix() @ ray)
    np.testing.assert_allclose(
        moved_pixel[:2] / moved_pixel[2], expected[:2] / expected[2], rtol=1e-12
    )
    np.testing.assert_allclose(h[1], np.eye(3), atol=1e-12)


def test_displacements_are_where_the_homography_leads() -> None:
    rng = np.random.default_rng(0)
    h = homographies(CAMERA, rng.normal(size=(5, 3)) * 0.03)
    points = rng.random((7, 2)) * [640, 480]
    moved = displacements(h, points)
    assert moved.shape == (7, 5, 2)
    moved_pixel = h[3] @ [*points[2], 1]
    np.testing.assert_allclose(moved[2, 3], moved_pixel[:2] / moved_pixel[2] - points[2], rtol=1e-9)


@given(arrays(np.float64, 3, elements=st.floats(-1e-3, 1e-3)))
def test_displacements_of_small_rotations(theta: np.ndarray) -> None:
    points = CAMERA.corners
    f = CAMERA.focal_px
    x, y = ((points - CAMERA.matrix[:2, 2]) / f).T
    ex, ey, ez = theta
    expected = f * np.stack(
        [-x * y * ex + (1 + x * x) * ey - y * ez, -(1 + y * y) * ex + x * y * ey + x * ez], 1
    )
    moved = displacements(homographies(CAMERA, theta[None]), points)[:, 0]
    # what remains is of second order in the angle
    np.testing.assert_allclose(moved, expected, atol=4 * f * (theta @ theta) + 1e-9)


@pytest.mark.parametrize("spacing", [0.25, 1.0, 2.0])
@pytest.mark.parametrize(("height", "width"), [(480, 640), (640, 480), (512, 512)])
def test_a_grid_step_moves_the_edge_of_the_frame(spacing: float, height: int, width: int) -> None:
    camera = Camera.from_focal(0.8 * 640, height, width)
    steps = grid_steps(camera, spacing) * 1e-3  # small enough for the linear formulas
    x0, y0 = camera.matrix[:2, 2]
    sides = np.array([[-0.5, y0], [width - 0.5, y0], [x0, -0.5], [x0, height - 0.5]])
    corners = np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]])
    points = np.concatenate([sides, corners])
    length = np.linalg.norm(displacements(homographies(camera, np.diag(steps)), points), axis=-1)
    expected = spacing * 1e-3
    assert length[:4, :2].max() == pytest.approx(expected, rel=1e-3)
    assert length[4:, 2] == pytest.approx(expected, rel=1e-3)


def test_a_grid_step_of_a_crop_counts_from_the_principal_point() -> None:
    crop = CAMERA.cropped(0, 0, 320, 240)
    np.testing.assert_allclose(grid_steps(crop), grid_steps(CAMERA))
