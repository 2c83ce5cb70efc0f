"""How alike two kernels are: by the local filters that they make at places of the frame.

The filters are smoothed by a share of their width, so that neighbouring rotations count as alike,
and compared by their normalised correlation at the shift where it is largest: no kernel knows where
the camera pointed on average.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import scipy.fft

from deshake.geometry.rotations import displacements, homographies

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel

__all__ = ["agreement", "spread_px"]

_PLACES = (0, 2, 4, 6, 8)  # of `Camera.corners`: the corners and the middle
_SMOOTHING = 0.3  # of the kernel's spread
_LEAST_SMOOTHING = 0.7  # px
_MOST_UNLIKE = 0.2  # of one spread to the other, below which kernels have nothing in common
_SIGMA = 1.5  # px that the smoothing comes to in the drawn filters


def spread_px(kernel: RotationKernel) -> float:
    """Root mean square of the displacements about their mean, over the frame, in pixels."""
    moved = kernel.displacements(kernel.camera.corners[list(_PLACES)])
    moved = moved - np.einsum("k,pki->pi", kernel.weights, moved)[:, None]
    return float(np.sqrt(np.einsum("k,pki->p", kernel.weights, moved**2).mean()))


def agreement(
    one: RotationKernel, other: RotationKernel, *, smoothing: float = _SMOOTHING
) -> float:
    """Return how alike two kernels of one photo are, 0..1.

    Parameters
    ----------
    one, other : RotationKernel
        Kernels for one camera.
    smoothing : float
        Smoothing of the filters, in spreads of the narrower kernel.

    """
    narrow, wide = sorted((spread_px(one), spread_px(other)))
    if narrow < _MOST_UNLIKE * wide:
        return 0.0
    sigma = max(smoothing * narrow, _LEAST_SMOOTHING)
    shrink = max(sigma / _SIGMA, 1.0)
    places = one.camera.corners[list(_PLACES)]
    found = []
    moved = [
        displacements(homographies(kernel.camera, kernel.theta), places) for kernel in (one, other)
    ]
    for at in range(len(places)):
        offsets = [
            (d[at] - kernel.weights @ d[at]) / shrink
            for d, kernel in zip(moved, (one, other), strict=True)
        ]
        reach = max(float(np.abs(offset).max()) for offset in offsets)
        side = int(2 * reach + 8 * sigma / shrink + 8)
        filters = [
            _drawn(offset, kernel.weights, side, sigma / shrink)
            for offset, kernel in zip(offsets, (one, other), strict=True)
        ]
        spectra = [scipy.fft.rfft2(drawn) for drawn in filters]
        shifted = scipy.fft.irfft2(spectra[0] * np.conj(spectra[1]), (side, side))
        found.append(float(shifted.max()))
    return float(np.mean(found))


def _drawn(
    offsets: NDArray[np.float64], weights: NDArray[np.float64], side: int, sigma: float
) -> NDArray[np.float32]:
    """Draw a filter in the middle of a square, smoothed, of unit norm."""
    picture = np.zeros((side, side), np.float32)
    place = offsets + side / 2
    low = np.floor(place).astype(np.int64)
    a, b = (place - low).T
    for dx, dy, share in (
        (0, 0, (1 - a) * (1 - b)),
        (1, 0, a * (1 - b)),
        (0, 1, (1 - a) * b),
        (1, 1, a * b),
    ):
        np.add.at(picture, (low[:, 1] + dy, low[:, 0] + dx), weights * share)
    smooth = cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    norm = np.linalg.norm(smooth)
    unit: NDArray[np.float32] = (smooth / norm).astype(np.float32)
    return unit
