"""Latent pictures of sharp edges only: L0 gradients, and the shock filter.

The picture S that a kernel is estimated from need not be right, only its strong edges. It is the
minimum of ``|A S - g|^2 + lam #{grad S != 0}`` (Xu, Zheng & Jia, CVPR 2013) by half-quadratic
splitting: gradients h of S below ``lam / beta`` are set to zero, S is solved for near h, and beta
grows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.signal.gradients import differences, length_of, strong

if TYPE_CHECKING:
    from deshake.blind.tiles import Tiles

__all__ = ["Edges", "l0_picture", "latent_edges", "shocked"]

Image = NDArray[np.float32]
Edges = Literal["shock", "l0", "strong"]

BETA_MAX = 16.0
_GROWTH = 2.83  # of beta
_SHOCK_STEPS = 2
_SHOCK_TIME = 0.5
_SHOCK_SIGMA = 1.0  # px
_SHOCK_FLOOR = 0.25  # gradients whose square is below this share of lam do not count


def l0_picture(
    tiles: Tiles, lam: float, *, beta_max: float = BETA_MAX
) -> tuple[Image, Image, Image]:
    """Minimise ``|A S - g|^2 + lam #{grad S != 0}`` in every tile.

    Parameters
    ----------
    tiles : Tiles
        With a kernel.
    lam : float
        Price of a pixel whose gradient is not zero, in the contrast of the pyramid.
    beta_max : float
        Largest weight of the split gradients.

    Returns
    -------
    picture, across, down : (P, N, N) arrays
        S, and its gradients without the small ones.

    """
    data = tiles.data()
    picture, beta = tiles.filled, 2 * lam
    while True:
        across, down = strong(*differences(picture), lam / beta)
        if beta >= beta_max:
            return picture, across, down
        picture = tiles.solved(data, across, down, beta)
        beta *= _GROWTH


def latent_edges(tiles: Tiles, lam: float, kind: Edges) -> tuple[Image, Image]:
    """Estimate the latent picture, fill in what is not believed, and return the edges that count.

    Parameters
    ----------
    tiles : Tiles
        With a kernel.
    lam : float
        Price of an edge.
    kind : {"shock", "l0", "strong"}
        Edges sharpened by the shock filter, those of the split gradients, or those of the latent
        picture that are worth their price.

    """
    picture, across, down = l0_picture(tiles, lam)
    tiles.fill(picture)
    if kind == "shock":
        return strong(*differences(shocked(picture)), _SHOCK_FLOOR * lam)
    if kind == "strong":
        return strong(*differences(picture), lam)
    return across, down


def shocked(blocks: Image) -> Image:
    """Sharpen the edges of blocks (P, N, N) by two steps of the shock filter (Osher & Rudin 1990).

    ``S <- S - dt sign(L) |grad S|`` with L the second derivative along the gradient of the
    smoothed picture and minmod differences. Blocks are worked on as one tall picture: what crosses
    from one to the next stays within the outermost pixels, which do not count.
    """
    picture = blocks.reshape(-1, blocks.shape[-1])
    for _ in range(_SHOCK_STEPS):
        smooth = cv2.GaussianBlur(picture, (0, 0), _SHOCK_SIGMA)
        gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125)
        gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125)
        bend = gx * gx * cv2.Sobel(smooth, cv2.CV_32F, 2, 0, scale=0.25)
        bend += 2 * gx * gy * cv2.Sobel(smooth, cv2.CV_32F, 1, 1, scale=0.25)
        bend += gy * gy * cv2.Sobel(smooth, cv2.CV_32F, 0, 2, scale=0.25)
        right, down = differences(picture)
        slope = length_of(_minmod(right, np.roll(right, 1, 1)), _minmod(down, np.roll(down, 1, 0)))
        picture = picture - np.float32(_SHOCK_TIME) * np.sign(bend) * slope
    return picture.reshape(blocks.shape)


def _minmod(a: Image, b: Image) -> Image:
    """Return the smaller of two differences, or zero where they disagree in sign."""
    smaller: Image = np.minimum(np.abs(a), np.abs(b))
    smaller *= (a * b) > 0
    return smaller
