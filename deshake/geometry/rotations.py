"""Rotations of the camera, the homographies of the picture (Eqs. 1-3), and the grid of Sec. 7.

A rotation is an angle-axis vector ``theta`` in radians: its direction is the axis, its length
the angle. X points right, Y down and Z along the optical axis into the scene.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from deshake.geometry.camera import Camera

__all__ = [
    "angle_axis",
    "compose",
    "displacements",
    "grid_steps",
    "homographies",
    "reach",
    "rotation_matrices",
]

_SMALL_ANGLE = 1e-4  # radians: below it the series of sin(a)/a, (1-cos a)/a^2 are exact in float64


def rotation_matrices(theta: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrices of angle-axis vectors, Eq. (2): ``R = exp([theta]_x)``.

    Parameters
    ----------
    theta : (..., 3) array
        Angle-axis vectors in radians.

    Returns
    -------
    (..., 3, 3) array of float64
        By Rodrigues' formula, with the cross-product matrix of Eq. (3).

    """
    theta = np.asarray(theta, np.float64)
    square = np.square(theta).sum(-1)
    angle = np.sqrt(square)
    small = angle < _SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1 - square / 6, np.sin(safe) / safe)
    cosine = np.where(small, 0.5 - square / 24, (1 - np.cos(safe)) / safe**2)
    # Eq. (2), with the square of Eq. (3): [theta]_x^2 = theta theta' - |theta|^2
    rotation: NDArray[np.float64] = (cosine[..., None] * theta)[..., None] * theta[..., None, :]
    rotation[..., range(3), range(3)] += (1 - cosine * square)[..., None]
    # Eq. (3)
    x, y, z = np.moveaxis(sine[..., None] * theta, -1, 0)
    for row, column, value in ((2, 1, x), (0, 2, y), (1, 0, z)):
        rotation[..., row, column] += value
        rotation[..., column, row] -= value
    return rotation


def angle_axis(rotation: ArrayLike) -> NDArray[np.float64]:
    """Angle-axis vectors (..., 3) of rotation matrices (..., 3, 3); angles within [0, pi)."""
    rotation = np.asarray(rotation, np.float64)
    axis = np.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        -1,
    )
    sine = np.linalg.norm(axis, axis=-1) / 2
    cosine = (np.trace(rotation, axis1=-2, axis2=-1) - 1) / 2
    angle = np.arctan2(sine, cosine)
    small = angle < _SMALL_ANGLE
    factor = np.where(small, 0.5 + angle**2 / 12, angle / (2 * np.where(small, 1.0, sine)))
    vector: NDArray[np.float64] = axis * factor[..., None]
    return vector


def compose(delta: ArrayLike, theta: ArrayLike) -> NDArray[np.float64]:
    """Angle-axis vectors of ``R(delta) R(theta)``: a correction composed on the left."""
    return angle_axis(rotation_matrices(delta) @ rotation_matrices(theta))


def homographies(camera: Camera, theta: ArrayLike) -> NDArray[np.float64]:
    """Homographies ``H_k = K R(theta_k) K^-1``, Eq. (1).

    Parameters
    ----------
    camera : Camera
        K and the size of the frame.
    theta : (..., 3) array
        Angle-axis vectors in radians.

    Returns
    -------
    (..., 3, 3) array of float64
        Each takes a pixel of the blurred photo to the pixel of the sharp one that it saw.

    """
    rotations = rotation_matrices(theta)
    # one product for all: row by row, K R K^-1 is R times the Kronecker product
    both = np.kron(camera.matrix.T, np.linalg.inv(camera.matrix))
    h: NDArray[np.float64] = (rotations.reshape(-1, 9) @ both).reshape(rotations.shape)
    return h


def displacements(h: ArrayLike, points: ArrayLike) -> NDArray[np.float64]:
    """Displacements ``d_k(p) = H_k p - p`` in pixels.

    Parameters
    ----------
    h : (K, 3, 3) array
        Homographies.
    points : (P, 2) array
        Pixels as (x, y).

    Returns
    -------
    (P, K, 2) array of float64

    """
    h = np.asarray(h, np.float64)
    points = np.asarray(points, np.float64)
    x, y, z = (points @ h[:, i, :2].T + h[:, i, 2] for i in range(3))  # (P, K)
    x /= z
    x -= points[:, :1]
    y /= z
    y -= points[:, 1:]
    return np.stack([x, y], -1)


def grid_steps(camera: Camera, spacing_px: float = 1.0) -> NDArray[np.float64]:
    """Compute the rotation grid's steps, which move the frame's edge by `spacing_px` (Sec. 7).

    Returns
    -------
    (3,) array of float64
        Radians about X, Y and Z. For X and Y: ``f / (f^2 + d^2)``, where d is the largest
        distance of a pixel from the principal point along an axis. For Z: one over the largest
        distance from it.

    """
    f = camera.focal_px
    x0, y0 = camera.matrix[0, 2], camera.matrix[1, 2]
    dx = max(x0 + 0.5, camera.width - 0.5 - x0)
    dy = max(y0 + 0.5, camera.height - 0.5 - y0)
    tilt = f / (f * f + max(dx, dy) ** 2)
    return spacing_px * np.array([tilt, tilt, 1 / np.hypot(dx, dy)])


def reach(camera: Camera, theta: ArrayLike) -> int:
    """Bound every displacement in the frame by rotations (K, 3), in pixels; taps are included."""
    moved = displacements(homographies(camera, theta), camera.corners)
    return int(np.ceil(np.abs(moved).max() - 1e-6)) + 1
