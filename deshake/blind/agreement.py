"""The agreement of two kernels, measured on their local filters at places of the frame.

Each filter is smoothed by a share of its width, so that neighbouring rotations count as alike. The
measure is the largest normalised correlation over all shifts of one filter against the other. The
shift does not count, because no photo shows the mean direction of the camera.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
import scipy.fft

from deshake.blind.settings import SETTINGS
from deshake.geometry.rotations import displacements, homographies
from deshake.operators.bilinear import BELOW, RIGHT, bilinear_shares

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel

__all__ = ["agreement", "spread_px"]

_PLACES = (0, 2, 4, 6, 8)  # indices into `Camera.corners`: the corners and the middle
_S: Final = SETTINGS.agreement


def spread_px(kernel: RotationKernel) -> float:
    """Return the root mean square of the displacements about their mean, in pixels.

    Each place of the frame has a mean of its own. The squares are averaged over all places.
    """
    moved = kernel.displacements(kernel.camera.corners[list(_PLACES)])
    moved = moved - np.einsum("k,pki->pi", kernel.weights, moved)[:, None]
    return float(np.sqrt(np.einsum("k,pki->p", kernel.weights, moved**2).mean()))


def agreement(
    one: RotationKernel, other: RotationKernel, *, smoothing: float = _S.smoothing
) -> float:
    """Measure the agreement of two kernels of one photo, 0..1.

    Parameters
    ----------
    one, other : RotationKernel
        Two kernels for the same camera.
    smoothing : float
        Standard deviation of the smoothing, as a share of the narrower kernel's spread.

    """
    narrow, wide = sorted((spread_px(one), spread_px(other)))
    if narrow < _S.most_unlike * wide:
        return 0.0
    sigma = max(smoothing * narrow, _S.least_smoothing)
    shrink = max(sigma / _S.drawn_sigma, 1.0)
    places = one.camera.corners[list(_PLACES)]
    correlations = []
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
        correlations.append(float(shifted.max()))
    return float(np.mean(correlations))


def _drawn(
    offsets: NDArray[np.float64], weights: NDArray[np.float64], side: int, sigma: float
) -> NDArray[np.float32]:
    """Draw a filter in the middle of a square, smooth it, and scale it to unit norm."""
    picture = np.zeros((side, side), np.float32)
    low, shares = bilinear_shares(offsets + side / 2)
    left, top = low.astype(np.int64).T
    for right, below, share in zip(RIGHT, BELOW, shares.T, strict=True):
        np.add.at(picture, (top + below, left + right), weights * share)
    smooth = cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    norm = np.linalg.norm(smooth)
    unit: NDArray[np.float32] = (smooth / norm).astype(np.float32)
    return unit
