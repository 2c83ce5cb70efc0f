"""Likeness to the truth: PSNR, SSIM, and the motion that no blind method can know."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from deshake.formats.transfer import Srgb

__all__ = [
    "Score",
    "aligned",
    "aligned_psnr",
    "decibels",
    "display",
    "motion_between",
    "projected",
    "psnr",
    "ssim",
]

Image = NDArray[np.float32]
Motion = NDArray[np.float32]

GREY = np.float32([0.299, 0.587, 0.114])


class Score(NamedTuple):
    """PSNR (dB), SSIM, and the processor seconds that were spent."""

    psnr: float
    ssim: float
    seconds: float = 0.0

    def __str__(self) -> str:
        """Show PSNR and SSIM."""
        return f"{self.psnr:.2f}/{self.ssim:.3f}"

    @classmethod
    def of(cls, ours: Image, truth: Image, where: NDArray[np.bool_] | None = None) -> Score:
        """Score display values (h, w, 3) over some pixels (h, w) or all."""
        return cls(psnr(ours, truth, where), ssim(ours, truth, where))


def display(light: Image) -> Image:
    """Return display values, 0..1, of linear light."""
    return Srgb().from_linear(np.clip(light, 0, 1)).astype(np.float32)


def decibels(squared: float, peak: float = 1.0) -> float:
    """Return the PSNR in dB of a mean squared error."""
    return float(10 * np.log10(peak**2 / squared))


def psnr(ours: Image, truth: Image, where: NDArray[np.bool_] | None = None) -> float:
    """Return the PSNR in dB of values 0..1, over some pixels (h, w) or all."""
    squares = np.square(ours - truth)
    return decibels(np.mean(squares if where is None else squares[where], dtype=float))


def ssim(ours: Image, truth: Image, where: NDArray[np.bool_] | None = None) -> float:
    """Return the SSIM of display values (h, w, 3), over some pixels (h, w) or all."""
    total, parts = structural_similarity(ours, truth, data_range=1, channel_axis=2, full=True)
    return float(total if where is None else parts[where].mean())


def motion_between(
    ours: Image,
    truth: Image,
    start: Motion,
    *,
    iterations: int,
    precision: float,
    smoothing: int = 5,
) -> Motion | None:
    """Estimate the motion from one grey picture to another by their correlation.

    Parameters
    ----------
    ours, truth : (h, w) arrays of float32
        The motion takes places of the truth to places of ours.
    start : (2, 3) or (3, 3) array of float32
        Where the search starts. The shape says what is estimated: a turn and a shift, or a
        homography.
    iterations, precision
        When the search stops.
    smoothing : int
        Pixels of the filter that smooths both pictures.

    Returns
    -------
    array like the start, or None
        None: nothing fits.

    """
    kind = cv2.MOTION_EUCLIDEAN if len(start) == 2 else cv2.MOTION_HOMOGRAPHY
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, iterations, precision)
    try:
        return cv2.findTransformECC(truth, ours, start.copy(), kind, stop, None, smoothing)[1]
    except cv2.error:
        return None


def aligned(ours: Image, truth: Image) -> Image:
    """Move a picture in colour to where it fits another best, by a shift and a turn."""
    still = np.eye(2, 3, dtype=np.float32)
    turn = motion_between(
        ours @ GREY, truth @ GREY, still, iterations=60, precision=1e-5, smoothing=3
    )
    if turn is None:
        return ours
    way = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    size = ours.shape[1], ours.shape[0]
    moved: Image = cv2.warpAffine(ours, turn, size, flags=way, borderMode=cv2.BORDER_REPLICATE)
    return moved


def aligned_psnr(ours: Image, truth: Image, border: int) -> float:
    """Return the PSNR in dB of display values (h, w, 3) without a border, aligned if that helps."""
    inner = np.s_[border:-border, border:-border]
    return max(psnr(one[inner], truth[inner]) for one in (ours, aligned(ours, truth)))


def projected(ours: NDArray[np.uint8], truth: NDArray[np.uint8]) -> Image:
    """Move 8-bit display values (BGR) to where they fit others best, by a homography."""
    one, other = _softened(ours), _softened(truth)
    window = cv2.createHanningWindow(other.shape[::-1], cv2.CV_32F)
    (dx, dy), _ = cv2.phaseCorrelate(other * window, one * window)
    shift = np.array([[1, 0, dx], [0, 1, dy], [0, 0, 1]], np.float32)
    motion = motion_between(one, other, shift, iterations=100, precision=1e-6)
    light = ours.astype(np.float32)
    if motion is None:
        return light
    way, size = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, (truth.shape[1], truth.shape[0])
    moved = cv2.warpPerspective(light, motion, size, None, way, cv2.BORDER_REPLICATE)
    return np.clip(moved, 0, 255)


def _softened(codes: NDArray[np.uint8]) -> Image:
    """Return what pictures are aligned by: grey, without noise."""
    grey = cv2.cvtColor(codes, cv2.COLOR_BGR2GRAY).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.5))
