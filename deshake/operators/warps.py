"""Exact maps: sums of warped images, one warp for each rotation (Eqs. 7-9).

``C_ijk`` is the bilinear weight of latent pixel j in observed pixel i under rotation k. The
forward map gathers with OpenCV's remap; the adjoint scatters with the same weights. (The warp by
the inverse homography is not the adjoint.) Frames are cut into tiles with origins of their own,
so that float32 coordinates stay exact to 1e-4 px at any size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.geometry.rotations import homographies, reach
from deshake.operators.filter_flow import checked_rotations, checked_weights
from deshake.operators.planes import channels_first, check_size
from deshake.operators.strips import bands

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike

    from deshake.geometry.camera import Camera

__all__ = ["Warps"]

Image = NDArray[np.float32]

_TILE = 256  # px: side of a tile
_EXACT_CHANNELS = (3, 4)  # OpenCV interpolates these and grey exactly, others at 1/32 px


@dataclass(frozen=True)
class _Tile:
    """Part of the observed frame, and where one rotation sends its pixels."""

    rows: slice
    columns: slice
    source: tuple[slice, slice]  # the latent pixels that it reads, with a border of one pixel
    x: Image  # latent coordinates within the source
    y: Image


class Warps:
    """The rotational blur model on a set of rotations, exactly.

    Parameters
    ----------
    camera : Camera
        The camera of the observed photo.
    theta : (K, 3) array
        Rotations in radians.
    margin : int, optional
        Pixels by which latent images are larger on every side; by default the reach of the
        rotations. Beyond the latent image all is zero.

    Raises
    ------
    ValueError
        If the rotations are not (K, 3) finite angles. The maps raise it if an image or the weights
        do not fit.

    Notes
    -----
    Images are float32, (h, w) or (h, w, C) observed and (h + 2 margin, w + 2 margin[, C]) latent.

    """

    def __init__(self, camera: Camera, theta: ArrayLike, *, margin: int | None = None) -> None:
        self.camera = camera
        self.theta = checked_rotations(theta)
        self.margin = reach(camera, self.theta) if margin is None else margin
        self._h = homographies(camera, self.theta)

    @property
    def latent_shape(self) -> tuple[int, int]:
        """Height and width of latent images in pixels."""
        return self.camera.height + 2 * self.margin, self.camera.width + 2 * self.margin

    def blur(self, f: Image, w: ArrayLike) -> Image:
        """Blur: ``A f = B w``, linear in the latent image and in the kernel, Eq. (7)."""
        weights = checked_weights(w, len(self.theta))
        check_size(channels_first(f), self.latent_shape)
        out = np.zeros(self.camera.shape + f.shape[2:], np.float32)
        for k in np.flatnonzero(weights).tolist():
            for tile in self._tiles(k):
                out[tile.rows, tile.columns] += np.float32(weights[k]) * _gather(f, tile)
        return out

    def adjoint(self, g: Image, w: ArrayLike) -> Image:
        """Apply the transpose in the image: ``A^T g``, by scattering, Eq. (8)."""
        weights = checked_weights(w, len(self.theta))
        check_size(channels_first(g), self.camera.shape)
        out = np.zeros(self.latent_shape + g.shape[2:], np.float32)
        for k in np.flatnonzero(weights).tolist():
            for tile in self._tiles(k):
                piece = g[tile.rows, tile.columns] * np.float32(weights[k])
                _scatter(out, tile, piece)
        return out

    def kernel_adjoint(self, f: Image, r: Image) -> NDArray[np.float64]:
        """Apply the transpose in the kernel: ``B^T r``, (K,), Eq. (9); channels are summed."""
        check_size(channels_first(f), self.latent_shape)
        check_size(channels_first(r), self.camera.shape)
        total = np.zeros(len(self.theta))
        for k in range(len(total)):
            for tile in self._tiles(k):
                warped = _gather(f, tile).astype(np.float64)
                total[k] += np.vdot(warped, r[tile.rows, tile.columns].astype(np.float64))
        return total

    def gram(self, f: Image, mask: Image | None = None) -> NDArray[np.float64]:
        """Compute ``B^T M B``, (K, K), row of tiles by row of tiles; channels are summed."""
        check_size(channels_first(f), self.latent_shape)
        size = len(self.theta)
        gram = np.zeros((size, size))
        for rows in bands(self.camera.height, 64):
            top, count = rows.start, rows.stop - rows.start
            columns = np.empty((size, count * self.camera.width * f[0, 0].size))
            for k in range(size):
                band = np.zeros((count, self.camera.width, *f.shape[2:]), np.float32)
                for tile in self._tiles(k, rows):
                    band[tile.rows.start - top : tile.rows.stop - top, tile.columns] = _gather(
                        f, tile
                    )
                if mask is not None:
                    root = np.sqrt(mask[rows])
                    band *= root if band.ndim == root.ndim else root[..., None]
                columns[k] = band.ravel()
            gram += columns @ columns.T
        return gram

    def _tiles(self, k: int, rows: slice | None = None) -> Iterator[_Tile]:
        """Cut the frame, or some rows of it, into tiles and map them by rotation k."""
        h = self._h[k]
        first, last = (0, self.camera.height) if rows is None else (rows.start, rows.stop)
        height, width = self.latent_shape
        for top in range(first, last, _TILE):
            for left in range(0, self.camera.width, _TILE):
                y = np.arange(top, min(top + _TILE, last), dtype=np.float64)[:, None]
                x = np.arange(left, min(left + _TILE, self.camera.width), dtype=np.float64)
                depth = h[2, 0] * x + (h[2, 1] * y + h[2, 2])
                u = (h[0, 0] * x + (h[0, 1] * y + h[0, 2])) / depth + self.margin
                v = (h[1, 0] * x + (h[1, 1] * y + h[1, 2])) / depth + self.margin
                x0 = int(np.clip(np.floor(u.min()) - 1, 0, width - 1))
                y0 = int(np.clip(np.floor(v.min()) - 1, 0, height - 1))
                x1 = int(np.clip(np.ceil(u.max()) + 2, x0 + 1, width))
                y1 = int(np.clip(np.ceil(v.max()) + 2, y0 + 1, height))
                yield _Tile(
                    slice(top, top + len(y)),
                    slice(left, left + len(x)),
                    (slice(y0, y1), slice(x0, x1)),
                    (u - x0).astype(np.float32),
                    (v - y0).astype(np.float32),
                )


def _gather(f: Image, tile: _Tile) -> Image:
    """Read a latent image bilinearly at a tile's coordinates; zero beyond it."""
    source = np.ascontiguousarray(f[tile.source], np.float32)
    if source.ndim == 2 or source.shape[2] in _EXACT_CHANNELS:
        return _remap(source, tile)
    planes = [_remap(np.ascontiguousarray(plane), tile) for plane in np.moveaxis(source, -1, 0)]
    return np.stack(planes, -1)


def _remap(source: Image, tile: _Tile) -> Image:
    """Interpolate bilinearly, with zeros beyond the source."""
    out = cv2.remap(
        source,
        tile.x,
        tile.y,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    return np.asarray(out, np.float32)


def _scatter(out: Image, tile: _Tile, piece: Image) -> None:
    """Add a tile's pixels to a latent image with the weights that `_gather` uses."""
    target = out[tile.source]
    height, width = target.shape[:2]
    x0, y0 = np.floor(tile.x), np.floor(tile.y)
    a, b = (tile.x - x0).astype(np.float64), (tile.y - y0).astype(np.float64)
    planes = piece[..., None] if piece.ndim == 2 else piece
    total = np.zeros((height * width, planes.shape[-1]))
    for dy, wy in ((0, 1 - b), (1, b)):
        for dx, wx in ((0, 1 - a), (1, a)):
            x, y = x0.astype(np.int64) + dx, y0.astype(np.int64) + dy
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            place = (y * width + x)[inside]
            share = (wx * wy)[inside]
            for c in range(planes.shape[-1]):
                total[:, c] += np.bincount(
                    place, share * planes[..., c][inside], minlength=height * width
                )
    target += total.reshape(target.shape).astype(np.float32)
