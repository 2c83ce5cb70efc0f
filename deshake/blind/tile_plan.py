"""The places of tiles at a scale: tiles for the fit of kernels, and tiles kept apart for the judge.

The frame is a chessboard of three colours. Tiles whose centre lies on one of the colours are kept
apart. The judge uses only those. No kernel is fitted to them, unless the photo is so small that the
tiles cover all of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from deshake.blind.tile_choice import chosen, covering
from deshake.blind.tiles import Tiles
from deshake.geometry.rotations import reach

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.blind.tile_choice import Corners
    from deshake.geometry.kernel import RotationKernel
    from deshake.signal.pyramid import Pyramid

__all__ = ["Budget", "Part", "informative_corners", "planned_tiles"]

Part = Literal["fitted", "apart", "all"]

_FIELDS = 12  # number of fields of the chessboard across the frame
_COLOURS = 3  # number of colours of the chessboard
_LEAST = 48  # px of the scale: least side of a tile
_LARGEST = 128  # px of the scale: largest side of a tile
_TURN = 3.0  # px: largest difference between the displacements of a tile's two ends
_FEWEST = 6  # least number of tiles
_NARROW = 8.0  # px of the scale: least length of the edges that count
_CUT = 0.05  # share of the largest weight; smaller weights do not count for the width


class Budget(NamedTuple):
    """Number of pixels of the tiles.

    Parameters
    ----------
    tiles : float
        Pixels of all chosen tiles.
    frame : float
        Pixels of the largest frame that tiles cover wholly.
    blocks : float
        Largest number of pixels of all blocks: the tiles and the room around them. Where a kernel
        rolls much, small tiles with wide rooms would cost several times as much as others.

    """

    tiles: float = 0.15e6
    frame: float = 0.15e6
    blocks: float = 0.5e6


def planned_tiles(
    pyramid: Pyramid,
    level: int,
    kernel: RotationKernel,
    *,
    part: Part = "fitted",
    budget: Budget = Budget(),  # noqa: B008 - it never changes
    room: float = 1.0,
) -> Tiles:
    """Cut tiles at a scale, with a size and a room that suit a kernel.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    level : int
        The scale.
    kernel : RotationKernel
        A kernel with all rotations that may get a weight, for the camera of the scale.
    part : {"fitted", "apart", "all"}
        The tiles for the fit of kernels, the tiles kept apart, or all tiles.
    budget : Budget
        Number of pixels in the tiles.
    room : float
        Room around the tiles, in reaches of the kernel.

    """
    scale = pyramid.at(level)
    far = int(np.ceil(room * reach(scale.camera, kernel.theta)))
    size = _size(kernel.theta, far, min(scale.camera.shape))
    most = max(int(budget.blocks / (size + 2 * far) ** 2), _FEWEST)
    covers = np.prod(scale.camera.shape) <= budget.frame
    corners = covering(scale.camera.shape, size)
    if not covers or len(corners) > most:
        count = most if covers else min(max(int(budget.tiles / size**2), _FEWEST), most)
        width = max(kernel.above(_CUT).extent_px(), _NARROW)
        corners = informative_corners(pyramid, level, size, count, width=width, part=part)
    return Tiles(scale, corners, size, far)


def informative_corners(
    pyramid: Pyramid, level: int, size: int, count: int, *, width: float, part: Part
) -> Corners:
    """Choose the most informative tiles of a part; see `tile_choice.chosen`."""
    return chosen(
        pyramid,
        level,
        size,
        count,
        width=width,
        allowed=lambda x, y: _belongs(_colour(x, y), part),
    )


def _size(theta: NDArray[np.float64], far: int, most: int) -> int:
    """Return an even tile size at which a rotation moves both ends of a tile nearly alike."""
    turn = float(np.ptp(theta, axis=0).max())
    least = max(_LEAST, min(2 * far, _LARGEST))
    size = min(int(np.clip(_TURN / max(turn, 1e-9), least, _LARGEST)), most)
    return size - size % 2


def _colour(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the colour of the chessboard at places in widths of the frame."""
    column, row = np.floor(x * _FIELDS).astype(np.int64), np.floor(y * _FIELDS).astype(np.int64)
    colour: NDArray[np.int64] = column + 2 * row
    return colour


def _belongs(colour: NDArray[np.int64] | int, part: Part) -> NDArray[np.bool_]:
    """Return whether a tile of a colour belongs to a part."""
    if part == "all":
        return np.ones_like(colour, bool)
    last: NDArray[np.bool_] = np.mod(colour, _COLOURS) == _COLOURS - 1
    return last if part == "apart" else ~last
