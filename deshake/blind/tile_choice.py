"""The choice of tiles that are most informative about the camera's rotations.

The information of a tile is the Fisher information of its edges about (theta_X, theta_Y, theta_Z).
It starts from the structure tensor of those edges that are longer than the width of the blur
(Xu & Jia, ECCV 2010); each edge counts up to a bound. The displacement of the tile's centre by each
rotation maps this tensor to the rotations. The choice is greedy: each step takes the tile that adds
most to the log determinant of the sum. So every axis counts, and the choice includes tiles in the
corners, which move with the roll, and edges of every direction.

A picture of few edges explains a strong edge in plain surroundings. Texture is like noise for it,
and hides what the edges say. So where such pictures are made, the plain share of a tile counts. The
spectra of texture say as much as those of edges, so they need no plain tiles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.geometry.rotations import displacements, grid_steps, homographies
from deshake.signal.gradients import length_of
from deshake.signal.noise import noise_level

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from deshake.signal.pyramid import Pyramid, Scale

__all__ = ["Corners", "chosen", "covering"]

Image = NDArray[np.float32]
Corners = list[tuple[int, int]]
Places = NDArray[np.float64]

_S: Final = SETTINGS.tile_choice

_TINY = np.float32(1e-12)  # least length of a gradient that others are divided by


def covering(shape: tuple[int, int], size: int) -> Corners:
    """Return the upper left pixels (y, x) of tiles that cover a frame."""
    rows, columns = (
        np.linspace(0, n - size, max(int(np.ceil(n / size)), 1)).astype(int) for n in shape
    )
    return [(int(y), int(x)) for y in rows for x in columns]


def chosen(
    pyramid: Pyramid,
    level: int,
    size: int,
    count: int,
    *,
    width: float,
    allowed: Callable[[Places, Places], NDArray[np.bool_]] | None = None,
    isolated: bool = False,
) -> Corners:
    """Choose tiles of a scale, the most informative first.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    level : int
        The scale.
    size : int
        Side of the tiles, in pixels of the scale.
    count : int
        Largest number of tiles.
    width : float
        Width of the blur, in pixels of the scale. Shorter edges give little information.
    allowed : callable, optional
        Whether tiles are allowed, from their centres (x, y) in widths of the frame; by default all
        are allowed.
    isolated : bool
        Whether the tiles are for pictures of few edges. Then strong edges in plain surroundings are
        wanted.

    Returns
    -------
    list of (y, x)
        Upper left pixels.

    """
    view = max(level, pyramid.level_of(_S.largest_view))
    scale = pyramid.at(view)
    shrink = scale.camera.width / pyramid.camera_at(level).width
    height, wide = pyramid.camera_at(level).shape
    hop = max(int(size * _S.nearest), _S.least_hop)
    rows, columns = (
        np.unique(np.linspace(0, n - size, int(np.ceil((n - size) / hop)) + 1).astype(int))
        for n in (height, wide)
    )
    y, x = (a.ravel() for a in np.meshgrid(rows, columns, indexing="ij"))
    least = _S.least_width
    window = 2 * int(np.ceil(max(width * shrink, least) / least)) * least + 1
    sums = pyramid.kept(
        ("tile sums", level, size, window),
        lambda: [
            _sums(one, x * shrink, y * shrink, size * shrink)
            for one in _maps(scale, pyramid.kept(("edges", view), lambda: _edges(scale)), window)
        ],
    )
    if allowed is not None:
        may = allowed((x + size / 2) / wide, (y + size / 2) / wide)
        if may.any():
            y, x, sums = y[may], x[may], [one[may] for one in sums]
    xx, xy, yy, uneven, clipped, *slopes = sums
    tensors = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    pixels = (size * shrink) ** 2
    weight = np.maximum(1 - _S.clipped * clipped / pixels, 0)
    information = _information(scale, tensors, (x + size / 2) * shrink, (y + size / 2) * shrink)
    if isolated:
        weight *= np.maximum(1 - uneven / pixels, 0) * _focus(slopes) ** _S.isolated_focus
    else:
        weight *= _focus(slopes) ** _S.focus
        information = _rooted(information)
    information *= weight[:, None, None]
    taken = _greedy(information, y, x, _S.apart * size, count)
    return [(int(y[p]), int(x[p])) for p in taken]


class _Edges(NamedTuple):
    """The gradients of a picture, whatever the width of the blur is.

    Parameters
    ----------
    gx, gy : (h, w) arrays of float32
        Gradients for the structure tensor, 0 at clipped pixels.
    slopes : list of pairs of (h, w) arrays of float32
        Gradients of the fine and of the coarse picture.
    noise, bound : float
        Noise of the picture; length of gx, gy from which an edge counts only this much.

    """

    gx: Image
    gy: Image
    slopes: list[tuple[Image, Image]]
    noise: float
    bound: float


def _edges(scale: Scale) -> _Edges:
    """Measure the gradients of a picture."""
    picture = scale.picture
    gx, gy = _gradients(picture, 1.0)
    if scale.clipped is not None:
        gx[scale.clipped] = 0
        gy[scale.clipped] = 0
    length = length_of(gx, gy)
    noise = max(noise_level(picture), _S.least_noise * float(length.mean()), 1e-9)
    slopes = [_gradients(picture, sigma) for sigma in _S.focus_sigmas]
    bound = max(float(np.quantile(length[::4, ::4], _S.bound)), _S.above_noise * noise)
    return _Edges(gx, gy, slopes, noise, bound)


def _maps(scale: Scale, edges: _Edges, window: int) -> Iterator[Image]:
    """Yield maps of the edges that are longer than a window, one by one, to save memory.

    Yields
    ------
    (h, w) arrays
        The terms of each pixel in the structure tensor (xx, xy, yy); 1 at pixels that are not
        plain; 1 at clipped pixels; and for each direction the fourth powers of the slopes in the
        fine and in the coarse picture.

    """
    length = length_of(edges.gx, edges.gy)
    box = window, window
    # near 1 along an edge that is longer than the width of the blur, near 0 in fine texture
    around = [cv2.boxFilter(one, -1, box).astype(np.float32) for one in (edges.gx, edges.gy)]
    straight = length_of(around[0], around[1])
    straight /= cv2.boxFilter(length, -1, box) + np.float32(_S.unsure * edges.noise)
    share = straight * np.minimum(1, np.float32(edges.bound) / np.maximum(length, _TINY))
    share *= length > edges.noise
    gx, gy = edges.gx * share, edges.gy * share
    yield gx * gx
    yield gx * gy
    yield gy * gy
    yield (length > np.float32(_S.texture * edges.bound)).astype(np.float32)
    clipped = np.zeros_like(gx)
    if scale.clipped is not None:
        clipped[scale.clipped] = 1
    yield clipped
    for angle in np.arange(_S.directions, dtype=np.float32) * np.float32(np.pi / _S.directions):
        for across, down in edges.slopes:
            yield cv2.pow((across * np.cos(angle) + down * np.sin(angle)) * straight, 4)


def _gradients(picture: Image, sigma: float) -> tuple[Image, Image]:
    """Return the gradients of a smoothed picture."""
    smooth = cv2.GaussianBlur(picture, (0, 0), sigma)
    across: Image = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125).astype(np.float32)
    down: Image = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125).astype(np.float32)
    return across, down


def _focus(slopes: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Measure the focus of tiles, 0..1, by the slope of their edges relative to the edges' height.

    The shake blurs all tiles alike; a tile out of focus has more blur. The slope of an edge in the
    coarse picture depends on its height alone. So the ratio of the two slopes measures the blur of
    the edge. An edge is compared only with edges of its own direction, because edges along the
    shake are steep everywhere.

    Parameters
    ----------
    slopes : list of (P,) arrays
        For each direction the sums of the fourth powers of the slopes, in the fine and in the
        coarse picture.

    """
    fine, coarse = (np.maximum(np.stack(slopes[i::2]), 0) ** 0.25 for i in (0, 1))
    steep = fine / np.maximum(coarse, 1e-3 * coarse.max() + 1e-30)
    lively = coarse >= np.quantile(coarse, _S.lively, axis=1, keepdims=True)
    best = np.array(
        [np.quantile(row[live], _S.focused) for row, live in zip(steep, lively, strict=True)]
    )
    share = np.clip(steep / np.maximum(best, 1e-9)[:, None], 0, 1)
    mean: NDArray[np.float64] = (share * coarse).sum(0) / np.maximum(coarse.sum(0), 1e-30)
    return mean


def _sums(
    values: Image, x: NDArray[np.float64], y: NDArray[np.float64], size: float
) -> NDArray[np.float64]:
    """Return sums of values over squares of a size, with upper left pixels (x, y)."""
    total = cv2.integral(values, sdepth=cv2.CV_64F)
    low, high = total.shape[0] - 1, total.shape[1] - 1
    top, left = np.rint(y).astype(int), np.rint(x).astype(int)
    bottom = np.clip(np.rint(y + size).astype(int), 0, low)
    right = np.clip(np.rint(x + size).astype(int), 0, high)
    sums: NDArray[np.float64] = (
        total[bottom, right] - total[top, right] - total[bottom, left] + total[top, left]
    )
    return sums


def _information(
    scale: Scale, tensors: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the information (P, 3, 3) about the rotations, in grid steps."""
    camera = scale.camera
    points = np.stack([x, y], 1)
    turned = homographies(camera, np.diag(grid_steps(camera)))
    moved = np.swapaxes(displacements(turned, points), 1, 2)  # (P, 2, 3)
    information: NDArray[np.float64] = np.einsum("pik,pij,pjl->pkl", moved, tensors, moved)
    return information


def _rooted(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return information that grows with the square root of the edges' power."""
    total = np.trace(information, axis1=1, axis2=2)
    root: NDArray[np.float64] = information / np.sqrt(total + 1e-12)[:, None, None]
    return root


def _greedy(
    information: NDArray[np.float64],
    y: NDArray[np.int64],
    x: NDArray[np.int64],
    apart: float,
    count: int,
) -> list[int]:
    """Take tiles one by one, each time the one that adds most to the log determinant."""
    total = np.trace(information, axis1=1, axis2=2)
    free = total > _S.least_information * total.max(initial=0)
    known = np.eye(3) * max(_S.prior * float(np.trace(information.mean(0))), 1e-12)
    taken: list[int] = []
    while free.any() and len(taken) < count:
        value = _determinants(known + information)
        best = int(np.argmax(np.where(free, value, -np.inf)))
        taken.append(best)
        known = known + information[best]
        free &= (np.abs(y - y[best]) >= apart) | (np.abs(x - x[best]) >= apart)
    return taken


def _determinants(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the determinants of symmetric matrices (P, 3, 3); NumPy needs 20 times as long."""
    (a, b, c), (_, d, e), (_, _, f) = np.moveaxis(matrices, 0, -1)
    determinants: NDArray[np.float64] = (
        a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    )
    return determinants
