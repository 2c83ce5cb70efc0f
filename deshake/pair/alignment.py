"""Alignment of two small pictures by a rotation, to a fraction of a pixel (Sec. 7).

One of the two is blurred by shake. If both are smoothed as widely as that blur, the best rotation
maps onto the blur's centroid. If they are smoothed less, the heaviest stroke of the blur attracts
the rotation. So finer scales do not improve a registration: they spoil it.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.variational.coarse_to_fine import turn
from deshake.geometry.rotations import compose, grid_steps
from deshake.pair.registration_settings import SETTINGS

if TYPE_CHECKING:
    from deshake.geometry.camera import Camera

__all__ = ["align", "likeness", "seen_in_frame", "smooth"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_MAD = 1.4826  # standard deviation per median absolute deviation of normal noise


def align(
    a: Image, b: Image, camera: Camera, theta: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Refine a rotation ``H`` such that ``a(x) ~ gain b(H^-1 x)``, by Gauss-Newton.

    Parameters
    ----------
    a, b : (h, w) arrays of float32
        The pictures, in linear light, about as bright as each other, longer side about 128
        pixels; `a` is blurred.
    camera : Camera
        The camera of both.
    theta : (3,) array
        Where to start, in radians.

    Returns
    -------
    theta : (3,) array of float64
        The rotation with the highest ZNCC of all iterations.
    score : float
        That ZNCC, of the smoothed pictures.

    """
    steps = grid_steps(camera)
    fields = _turning_fields(camera) * steps[:, None, None, None]
    smooth_a = smooth(a, SETTINGS.smooth_px, SETTINGS.slow_px)
    best, best_score = theta, -1.0
    for _ in range(SETTINGS.iterations):
        turned, mask = seen_in_frame(a, b, camera, theta)
        turned = smooth(turned, SETTINGS.smooth_px, SETTINGS.slow_px)
        mask = _within(mask, SETTINGS.smooth_px)
        if mask.sum() < SETTINGS.least_pixels:
            break
        score = _correlation(smooth_a[mask], turned[mask])
        if score > best_score:
            best, best_score = theta, score
        dy, dx = np.gradient(turned)
        columns = [fx * dx + fy * dy for fx, fy in fields] + [turned, np.ones_like(turned)]
        fit = _robust_fit(np.stack([column[mask] for column in columns], 1), smooth_a[mask])
        step = fit[:3] / max(fit[3], 0.2)  # pixels at the frame's edge
        longest = float(np.abs(step).max())
        theta = compose(
            step * steps * min(1.0, SETTINGS.longest_step_px / max(longest, 1e-9)), theta
        )
        if longest < SETTINGS.enough_px:
            break
    return best, best_score


def likeness(a: Image, b: Image, camera: Camera, theta: NDArray[np.float64]) -> float:
    """Measure how alike ``a(x)`` and ``b(H^-1 x)`` are, over the whole frame.

    Returns
    -------
    float
        The mean of two ZNCCs of details: that of the whole frame, and the lower quartile of those
        of its blocks. Pictures of different scenes may share one edge, but not edges everywhere.

    """
    turned, mask = seen_in_frame(a, b, camera, theta)
    mask = _within(mask, 2 * SETTINGS.fine_px)
    if mask.sum() < SETTINGS.least_pixels:
        return 0.0
    details = smooth(a, SETTINGS.fine_px, SETTINGS.coarse_px)
    # The other picture is the sharper one.
    others = smooth(turned, 2 * SETTINGS.fine_px, SETTINGS.coarse_px)
    rows, columns = (np.linspace(0, side, SETTINGS.blocks + 1).astype(int) for side in a.shape)
    blocks = []
    for top, bottom in pairwise(rows):
        for left, right in pairwise(columns):
            block = np.s_[top:bottom, left:right]
            if mask[block].mean() > 0.5:
                blocks.append(_correlation(details[block][mask[block]], others[block][mask[block]]))
    whole = _correlation(details[mask], others[mask])
    return float((whole + np.quantile(blocks, 0.25)) / 2) if blocks else 0.0


def seen_in_frame(
    a: Image, b: Image, camera: Camera, theta: NDArray[np.float64]
) -> tuple[Image, Mask]:
    """Return ``b(H^-1 x)``, and where `b` covers it; elsewhere it is `a`, which avoids an edge."""
    turned, weight = turn(np.stack([b, np.ones_like(b)]), camera, -theta)
    mask = weight > 0.99
    return np.where(mask, turned, a), mask


def smooth(image: Image, fine_px: float, coarse_px: float) -> Image:
    """Keep the detail between two scales: a difference of Gaussians."""
    fine = cv2.GaussianBlur(image, (0, 0), fine_px)
    return np.asarray(fine - cv2.GaussianBlur(fine, (0, 0), coarse_px), np.float32)


def _within(mask: Mask, sigma: float) -> Mask:
    """Remove the pixels that smoothing mixes with others from beyond the mask or the frame."""
    side = 2 * int(np.ceil(1.5 * sigma)) + 1
    shrunk = cv2.erode(mask.astype(np.uint8), np.ones((side, side), np.uint8), borderValue=0)
    inside: Mask = shrunk > 0
    return inside


def _turning_fields(camera: Camera) -> NDArray[np.float32]:
    """Return displacements (3, 2, h, w) of ``H(-delta) x`` for small rotations about X, Y, Z."""
    f = camera.focal_px
    x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    X, Y = (x - camera.matrix[0, 2]) / f, (y - camera.matrix[1, 2]) / f
    fields = [(X * Y, 1 + Y * Y), (-1 - X * X, -X * Y), (Y, -X)]
    return (f * np.array(fields)).astype(np.float32)


def _robust_fit(A: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float64]:
    """Solve ``A p ~ b`` by least squares, then once more with Huber's weights."""
    A64, b64 = A.astype(np.float64), b.astype(np.float64)
    weights = np.ones(len(b64))
    for _ in range(2):
        normal = A64.T @ (A64 * weights[:, None])
        damping = 1e-4 * np.diag(normal) + 1e-12
        p = np.linalg.solve(normal + np.diag(damping), A64.T @ (weights * b64))
        residual = np.abs(b64 - A64 @ p)
        sigma = _MAD * float(np.median(residual)) + 1e-12
        weights = np.minimum(1, SETTINGS.huber * sigma / np.maximum(residual, 1e-12))
    return np.asarray(p, np.float64)


def _correlation(x: NDArray[np.float32], y: NDArray[np.float32]) -> float:
    """Return the ZNCC of two lists of values; 0 if one of them is constant."""
    x64, y64 = x - x.mean(dtype=np.float64), y - y.mean(dtype=np.float64)
    norm = float(np.sqrt((x64 @ x64) * (y64 @ y64)))
    return float(x64 @ y64) / norm if norm > 1e-9 else 0.0
