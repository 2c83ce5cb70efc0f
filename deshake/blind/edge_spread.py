"""Measure the spread of a photo's edges at its finest scale, along and across the blur.

A blur of standard deviation ``s`` spreads an edge. Smoothed by Gaussians of ``s1`` and ``s2``, the
edge has slopes in the ratio ``sqrt((s2^2 + s^2) / (s1^2 + s^2))`` (Zhuo & Sim, "Defocus map
estimation from a single image", Pattern Recognition 2011). A blur of covariance ``Sigma`` spreads
an edge of normal ``n`` by ``s^2 = n^T Sigma n``. So the sharper edges of each direction give
``Sigma`` by a linear fit.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.blind.tile_choice import chosen
from deshake.signal.gradients import length_of
from deshake.signal.noise import noise_level

if TYPE_CHECKING:
    from deshake.signal.pyramid import Pyramid

__all__ = ["EdgeSpread", "edge_spread"]

Image = NDArray[np.float32]
Points = NDArray[np.float64]

_S: Final = SETTINGS.edge_spread


class EdgeSpread(NamedTuple):
    """Standard deviations of the blur of the sharper edges, in pixels of the photo.

    Edges with a blur far wider than two pixels give about 2 to 4.
    """

    longer: float
    shorter: float


def edge_spread(pyramid: Pyramid) -> EdgeSpread | None:
    """Measure the spread of a photo's edges; None: too few edges."""
    scale = pyramid.at(0)
    if min(scale.picture.shape) < _S.tile or scale.picture.size <= _S.whole * _S.tiles * _S.tile**2:
        size, corners = max(scale.picture.shape), [(0, 0)]
    else:
        size, corners = _S.tile, chosen(pyramid, 0, _S.tile, _S.tiles, width=_S.longest_edges)
    places = [np.s_[y : y + size, x : x + size] for y, x in corners]
    blocks = [np.sqrt(np.clip(scale.picture[place], 0, 1)) for place in places]
    clipped = [None if scale.clipped is None else scale.clipped[place] for place in places]
    noise = float(np.median([noise_level(block) for block in blocks])) if blocks else 0.0
    points = [_edges(block, mask, noise) for block, mask in zip(blocks, clipped, strict=True)]
    return _ellipse(np.concatenate(points)) if points else None


def _edges(block: Image, clipped: NDArray[np.bool_] | None, noise: float) -> Points:
    """Return the angle of each edge pixel's normal and the squared ratio of its slopes, (N, 2)."""
    fine, coarse = _gradients(block, _S.fine), _gradients(block, _S.coarse)
    slope = length_of(*coarse)
    across, down = (part / np.maximum(slope, 1e-9) for part in coarse)
    window = _S.around, _S.around
    xx, yy, xy = (
        cv2.boxFilter(one, -1, window)
        for one in (coarse[0] ** 2, coarse[1] ** 2, coarse[0] * coarse[1])
    )
    straight = np.hypot(xx - yy, 2 * xy) > _S.straight * (xx + yy)
    y, x = np.indices(block.shape, np.float32)
    before, after = (
        cv2.remap(slope, x + sign * across, y + sign * down, cv2.INTER_LINEAR) for sign in (-1, 1)
    )
    least = max(_S.above_noise * noise / (math.sqrt(8 * math.pi) * _S.coarse**2), _S.least_slope)
    edge = straight & (slope >= before) & (slope > after) & (slope > least)
    if clipped is not None:
        edge &= cv2.dilate(clipped.astype(np.uint8), np.ones((_S.clear, _S.clear), np.uint8)) == 0
    margin = math.ceil(3 * _S.coarse)
    inner = np.zeros_like(edge)
    inner[margin:-margin, margin:-margin] = True
    edge &= inner
    steep = np.maximum((fine[0] * across + fine[1] * down)[edge], 1e-9)
    angle = np.arctan2(down[edge], across[edge]) % np.pi
    return np.stack([angle, (slope[edge] / steep) ** 2], 1).astype(np.float64)


def _gradients(block: Image, sigma: float) -> tuple[Image, Image]:
    smooth = cv2.GaussianBlur(block, (0, 0), sigma)
    across: Image = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=1, scale=0.5).astype(np.float32)
    down: Image = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=1, scale=0.5).astype(np.float32)
    return across, down


def _ellipse(points: Points) -> EdgeSpread | None:
    """Fit the blur's covariance to the sharper edges of all directions."""
    number = np.rint(points[:, 0] / np.pi * _S.directions).astype(int) % _S.directions
    rows, variances, weights = [], [], []
    for direction in range(_S.directions):
        ratios = points[number == direction, 1]
        if len(ratios) < _S.fewest:
            continue
        ratio = float(np.clip(np.quantile(ratios, _S.sharper), *_S.ratios))
        variance = (ratio * _S.coarse**2 - _S.fine**2) / (1 - ratio)
        c, s = (part(direction * math.pi / _S.directions) for part in (math.cos, math.sin))
        rows.append([c * c, 2 * c * s, s * s])
        variances.append(variance)
        weights.append(math.sqrt(min(len(ratios), _S.most)) / (1 + max(variance, 0)))
    if len(rows) < 3:
        return None
    design, weight = np.array(rows), np.array(weights)
    xx, xy, yy = np.linalg.lstsq(design * weight[:, None], variances * weight, rcond=None)[0]
    shorter, longer = np.sqrt(np.maximum(np.linalg.eigvalsh([[xx, xy], [xy, yy]]), 0))
    return EdgeSpread(float(longer), float(shorter))
