"""Latent pictures of sharp edges only: L0 gradients, and the shock filter.

The kernel is estimated from a picture S. Only the strong edges of S must be right. S minimises
``|A S - g|^2 + lam #{grad S != 0}`` (Xu, Zheng & Jia, CVPR 2013) by half-quadratic splitting. Each
step sets those gradients h of S to zero whose square is below ``lam / beta``, solves for an S whose
gradients are near h, and increases beta.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.signal.gradients import differences, length_of, strong

if TYPE_CHECKING:
    from deshake.blind.tiles import Tiles

__all__ = ["Edges", "l0_picture", "latent_edges", "shocked"]

Image = NDArray[np.float32]
Edges = Literal["shock", "l0", "strong"]

_S: Final = SETTINGS.sharp_edges


def l0_picture(
    tiles: Tiles, lam: float, *, beta_max: float = _S.beta_max, growth: float = _S.growth
) -> tuple[Image, Image, Image]:
    """Minimise ``|A S - g|^2 + lam #{grad S != 0}`` in every tile.

    Parameters
    ----------
    tiles : Tiles
        Tiles that are bound to a kernel.
    lam : float
        Price of a pixel whose gradient is not zero, in squared contrast of the pyramid.
    beta_max : float
        Largest weight of the split gradients.
    growth : float
        Factor of this weight between two steps.

    Returns
    -------
    picture, across, down : (P, N, N) arrays
        S, and its gradients, the small ones set to zero.

    """
    result = np.empty((3, *tiles.g.shape), np.float32)
    for part, group in tiles.groups():
        result[:, part] = _l0_picture(group, lam, beta_max, growth)
    picture, across, down = result
    return picture, across, down


def _l0_picture(
    tiles: Tiles, lam: float, beta_max: float, growth: float
) -> tuple[Image, Image, Image]:
    """Run the steps of `l0_picture` on a few tiles."""
    data = tiles.data()
    picture, beta = tiles.filled, 2 * lam
    while True:
        across, down = strong(*differences(picture), lam / beta)
        if beta >= beta_max:
            return picture, across, down
        picture = tiles.solved(data, across, down, beta)
        beta *= growth


def latent_edges(tiles: Tiles, lam: float, kind: Edges) -> tuple[Image, Image]:
    """Estimate the latent picture, fill in the unknown pixels, and return the strong edges.

    Parameters
    ----------
    tiles : Tiles
        Tiles that are bound to a kernel.
    lam : float
        Price of an edge pixel, in squared contrast of the pyramid.
    kind : {"shock", "l0", "strong"}
        Which edges: those that the shock filter sharpens, the split gradients, or the gradients of
        the latent picture whose square exceeds the price.

    """
    picture, across, down = l0_picture(tiles, lam)
    tiles.fill(picture)
    if kind == "shock":
        return strong(*differences(shocked(picture)), _S.shock_floor * lam)
    if kind == "strong":
        return strong(*differences(picture), lam)
    return across, down


def shocked(blocks: Image) -> Image:
    """Sharpen the edges of blocks (P, N, N) by two steps of the shock filter (Osher & Rudin 1990).

    ``S <- S - dt sign(L) |grad S|`` with minmod differences. L is the second derivative of the
    smoothed picture along its gradient. The filter treats the blocks as one tall picture. So
    neighbouring blocks affect each other, but only at the outermost pixels, which do not count.
    """
    picture = blocks.reshape(-1, blocks.shape[-1])
    for _ in range(_S.shock_steps):
        smooth = cv2.GaussianBlur(picture, (0, 0), _S.shock_sigma)
        gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125)
        gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125)
        bend = gx * gx * cv2.Sobel(smooth, cv2.CV_32F, 2, 0, scale=0.25)
        bend += 2 * gx * gy * cv2.Sobel(smooth, cv2.CV_32F, 1, 1, scale=0.25)
        bend += gy * gy * cv2.Sobel(smooth, cv2.CV_32F, 0, 2, scale=0.25)
        right, down = differences(picture)
        slope = length_of(_minmod(right, np.roll(right, 1, 1)), _minmod(down, np.roll(down, 1, 0)))
        picture = picture - np.float32(_S.shock_time) * np.sign(bend) * slope
    return picture.reshape(blocks.shape)


def _minmod(a: Image, b: Image) -> Image:
    """Return the smaller of two differences, or zero if their signs differ."""
    smaller: Image = np.minimum(np.abs(a), np.abs(b))
    smaller *= (a * b) > 0
    return smaller
