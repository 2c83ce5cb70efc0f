"""Latent pictures of sharp edges only: L0 gradients and the shock filter.

The picture S that a kernel is estimated from need not be right, only its strong edges. It is the
minimum of ``|A S - g|^2 + lam #{grad S != 0}`` (Xu, Zheng & Jia, CVPR 2013), by half-quadratic
splitting: gradients h of S below ``lam / beta`` are set to zero, S is solved for near h, and beta
grows. What is not known of g, beyond the border or clipped, is filled with what A S says of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError

if TYPE_CHECKING:
    from deshake.operators.patch_solve import PatchSolver

__all__ = [
    "Observation",
    "contrast_scaled",
    "differences",
    "edge_gradients",
    "l0_picture",
    "least_price",
    "noise_level",
    "shocked",
    "strong_gradients",
]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_CONTRAST = 0.1  # rms gradient, reduced to `_CONTRAST_SIDE`
_CONTRAST_SIDE = 100  # px, the longer side
_LEAST_CONTRAST = 1e-4  # of 0..1: below it there is nothing to go by
_SECOND_DIFFERENCES = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
_MEDIAN = 0.6745  # of the absolute value of a standard normal variable
_LEAST_PRICE = 10.0  # of an edge, in variances of the noise
_BETA_GROWTH = 2.83
_SHOCK_STEPS = 2
_SHOCK_TIME = 0.5
_SHOCK_SIGMA = 1.0  # px
_SHOCK_FLOOR = 0.25  # gradients whose square is below this share of lam do not count


def contrast_scaled(grey: Image) -> tuple[Image, float]:
    """Scale a picture so that its rms gradient is 0.1 when reduced to 100 px.

    The thresholds of L0 gradients are absolute: pictures must come with one contrast.

    Returns
    -------
    picture : (h, w) array
        The scaled picture.
    scale : float
        What it was multiplied by.

    Raises
    ------
    EstimationError
        If the picture is flat.

    """
    shrink = min(1.0, _CONTRAST_SIDE / max(grey.shape))
    size = max(round(grey.shape[1] * shrink), 2), max(round(grey.shape[0] * shrink), 2)
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    across, down = np.diff(small, axis=1)[:-1], np.diff(small, axis=0)[:, :-1]
    contrast = float(np.sqrt((across**2 + down**2).mean()))
    if not contrast > _LEAST_CONTRAST:
        msg = "there is no texture to estimate a blur kernel from"
        raise EstimationError(msg, hint="the photo is all of one colour, or nearly so")
    scale = _CONTRAST / contrast
    return (grey * np.float32(scale)).astype(np.float32), scale


def noise_level(picture: Image, where: Mask | None = None) -> float:
    """Estimate the standard deviation of white noise, by the median of second differences."""
    rough = cv2.filter2D(picture, -1, _SECOND_DIFFERENCES)
    return float(np.median(np.abs(rough if where is None else rough[where]))) / _MEDIAN


def least_price(picture: Image) -> float:
    """Price `lam` of an edge that tells it from the noise of a picture."""
    return _LEAST_PRICE * noise_level(picture) ** 2


def differences(image: Image) -> tuple[Image, Image]:
    """Differences to the right and to the lower neighbour; the far edges meet the near ones."""
    return np.roll(image, -1, 1) - image, np.roll(image, -1, 0) - image


@dataclass(frozen=True, eq=False)
class Observation:
    """A blurred picture with its margin, and which of its pixels are known.

    Parameters
    ----------
    picture : (H, W) array
        The picture less its mean; in the margin its border fades to zero.
    known : (H, W) array of bool
        Pixels that were observed and are believed.
    taper : (H, W) array
        1 within the frame, falling to 0 across the margin.
    margin : int
        Pixels added on every side.

    """

    picture: Image
    known: Mask
    taper: Image
    margin: int

    @classmethod
    def of(cls, grey: Image, margin: int, usable: Mask | None = None) -> Observation:
        """Put a margin around a picture (h, w)."""
        high, wide = grey.shape
        ramp = 0.5 - 0.5 * np.cos(np.pi * (np.arange(margin) + 0.5) / margin)
        y = np.concatenate([ramp, np.ones(high), ramp[::-1]])
        x = np.concatenate([ramp, np.ones(wide), ramp[::-1]])
        taper = np.outer(y, x).astype(np.float32)
        around = (margin,) * 4
        level = np.float32(grey.mean())
        picture = cv2.copyMakeBorder(grey - level, *around, cv2.BORDER_REPLICATE) * taper
        believed = np.ones(grey.shape, np.uint8) if usable is None else usable.astype(np.uint8)
        known = cv2.copyMakeBorder(believed, *around, cv2.BORDER_CONSTANT, value=0) > 0
        return cls(picture.astype(np.float32), known, taper, margin)

    def filled(self, blurred: Image) -> Image:
        """Take what is not known from a blurred estimate (H, W)."""
        return np.where(self.known, self.picture, blurred * self.taper)


def l0_picture(
    solver: PatchSolver, g: Image, lam: float, *, beta_max: float
) -> tuple[Image, Image, Image]:
    """Minimise ``|A S - g|^2 + lam #{grad S != 0}`` by half-quadratic splitting.

    Parameters
    ----------
    solver : PatchSolver
        The kernel.
    g : (H, W) array
        The blurred picture with its margin, in the contrast of `contrast_scaled`.
    lam : float
        Price of a pixel whose gradient is not zero.
    beta_max : float
        The weight of the split gradients grows up to this.

    Returns
    -------
    picture, across, down : (H, W) arrays
        S, and its gradients without the small ones.

    """
    data = solver.data(g)
    picture = g
    beta = 2 * lam
    while True:
        hx, hy = _above(*differences(picture), lam / beta)
        if beta >= beta_max:
            return picture, hx, hy
        picture = solver.solve(data, hx, hy, beta)
        beta *= _BETA_GROWTH


def edge_gradients(picture: Image, lam: float) -> tuple[Image, Image]:
    """Gradients of the shock-filtered picture, without those far below an edge's."""
    return _above(*differences(shocked(picture)), _SHOCK_FLOOR * lam)


def strong_gradients(picture: Image, lam: float) -> tuple[Image, Image]:
    """Gradients of a picture whose squared length is `lam` or more: steps worth their price."""
    return _above(*differences(picture), lam)


def shocked(picture: Image) -> Image:
    """Sharpen edges by two steps of the shock filter (Osher & Rudin 1990).

    ``S <- S - dt sign(L) |grad S|`` with L the second derivative along the gradient of the
    smoothed picture and minmod differences.
    """
    for _ in range(_SHOCK_STEPS):
        smooth = cv2.GaussianBlur(picture, (0, 0), _SHOCK_SIGMA)
        gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125)
        gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125)
        gxx = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, scale=0.25)
        gyy = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, scale=0.25)
        gxy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, scale=0.25)
        bend = gx * gx * gxx + 2 * gx * gy * gxy + gy * gy * gyy
        right, down = differences(picture)
        slope = np.hypot(_minmod(right, np.roll(right, 1, 1)), _minmod(down, np.roll(down, 1, 0)))
        picture = picture - np.float32(_SHOCK_TIME) * np.sign(bend) * slope
    return picture


def _above(x: Image, y: Image, square: float) -> tuple[Image, Image]:
    """Set gradients to zero whose squared length is below a bound."""
    strong = x * x + y * y >= np.float32(square)
    return x * strong, y * strong


def _minmod(a: Image, b: Image) -> Image:
    """Return the smaller of two differences, or zero where they disagree in sign."""
    smaller: Image = np.where(np.abs(a) < np.abs(b), a, b)
    return smaller * (a * b > 0)
