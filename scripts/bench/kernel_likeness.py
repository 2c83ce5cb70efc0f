"""The likeness of two kernels, up to a turn of the camera between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from deshake.geometry.rotations import displacements, homographies

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel

__all__ = ["similarity"]

POINTS = [0, 2, 4, 6, 8]  # corners and middle of the frame


def local_filter(
    weights: NDArray[np.float64], moves: NDArray[np.float64], side: int, sigma: float
) -> NDArray[np.float32]:
    """Draw a kernel's filter at a point, smoothed; its norm is 1."""
    image = np.zeros((side, side), np.float32)
    place = moves + side / 2
    corner = np.floor(place).astype(int)
    part = place - corner
    for dx in (0, 1):
        for dy in (0, 1):
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            at = np.clip(corner + np.array([dx, dy]), 0, side - 1)
            np.add.at(image, (at[:, 1], at[:, 0]), weights * share)
    smooth = cv2.GaussianBlur(image, (0, 0), sigma)
    return np.asarray(smooth / np.linalg.norm(smooth))


def similarity(ours: RotationKernel, truth: RotationKernel, extent: float) -> float:
    """Return the largest correlation of two kernels' filters over shifts, on average."""
    sigma = max(0.06 * extent, 0.7)
    peaks = []
    for point in truth.camera.corners[POINTS]:
        drawn = []
        for kernel in (ours, truth):
            moves = displacements(homographies(kernel.camera, kernel.theta), point[None])
            moves = moves.reshape(-1, 2)
            drawn.append((kernel.weights, moves - kernel.weights @ moves))
        far = max(np.abs(moves).max() for _, moves in drawn)
        side = max(int(2 * far + 8 * sigma + 8), 16)
        one, other = (np.fft.rfft2(local_filter(*item, side, sigma)) for item in drawn)
        peaks.append(np.fft.irfft2(one * other.conj(), s=(side, side)).max())
    return float(np.mean(peaks))
