"""Where tiles lie at a scale: those that kernels are fitted to, and those that are kept apart.

The frame is a chessboard of three colours. Tiles whose middle lies on one of them are kept apart:
no kernel is fitted to them once the photo is large enough for tiles to be chosen, and the judge
looks at nothing else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from deshake.blind.tile_choice import FOCUS, chosen, covering
from deshake.blind.tiles import Tiles, reach

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel
    from deshake.signal.pyramid import Pyramid

__all__ = ["Budget", "Part", "is_covered", "planned_tiles"]

Part = Literal["fitted", "apart", "all"]

_FIELDS = 12  # of the chessboard, across the frame
_COLOURS = 3
_LEAST = 48  # px, of a tile
_LARGEST = 128  # px, of a tile
_TURN = 3.0  # px by which the ends of a tile may be moved differently
_FEWEST = 6  # tiles
_NARROW = 8.0  # px: edges must be as long at least
_CUT = 0.05  # weights below this share of the largest do not make a kernel wider


class Budget(NamedTuple):
    """Pixels of all tiles, and of the largest frame that tiles cover as a whole."""

    tiles: float = 0.15e6
    frame: float = 0.15e6


def planned_tiles(
    pyramid: Pyramid,
    level: int,
    kernel: RotationKernel,
    *,
    part: Part = "fitted",
    budget: Budget = Budget(),  # noqa: B008 - it never changes
    room: float = 1.0,
    focus: float = FOCUS,
) -> Tiles:
    """Cut the tiles of a scale that suit a kernel: its room, and its roll.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    level : int
        The scale.
    kernel : RotationKernel
        All rotations that may get a weight, for the camera of the scale.
    part : {"fitted", "apart", "all"}
        Which tiles.
    budget : Budget
        How many pixels to look at.
    room : float
        Room around the tiles, in reaches of the kernel.
    focus : float
        How much tiles in focus are preferred, as for `chosen`.

    """
    scale = pyramid.at(level)
    far = int(np.ceil(room * reach(scale.camera, kernel.theta)))
    size = _size(kernel.theta, far, min(scale.camera.shape))
    if is_covered(pyramid, level, budget):
        corners = covering(scale.camera.shape, size)
    else:
        count = max(int(budget.tiles / size**2), _FEWEST)
        width = max(kernel.above(_CUT).extent_px(), _NARROW)
        corners = chosen(
            pyramid,
            level,
            size,
            count,
            width=width,
            allowed=lambda x, y: _belongs(_colour(x, y), part),
            focus=focus,
        )
    return Tiles(scale, corners, size, far)


def is_covered(pyramid: Pyramid, level: int, budget: Budget = Budget()) -> bool:  # noqa: B008
    """Whether tiles cover all of a scale, instead of being chosen."""
    return bool(np.prod(pyramid.at(level).camera.shape) <= budget.frame)


def _size(theta: NDArray[np.float64], far: int, most: int) -> int:
    """Size of tiles over which the rotations all move much alike, even."""
    turn = float(np.ptp(theta, axis=0).max())
    least = max(_LEAST, min(2 * far, _LARGEST))
    size = min(int(np.clip(_TURN / max(turn, 1e-9), least, _LARGEST)), most)
    return size - size % 2


def _colour(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int64]:
    """Colour of the chessboard at places in widths of the frame."""
    column, row = np.floor(x * _FIELDS).astype(np.int64), np.floor(y * _FIELDS).astype(np.int64)
    colour: NDArray[np.int64] = column + 2 * row
    return colour


def _belongs(colour: NDArray[np.int64] | int, part: Part) -> NDArray[np.bool_]:
    """Whether a tile of a colour belongs to a part."""
    if part == "all":
        return np.ones_like(colour, bool)
    last: NDArray[np.bool_] = np.mod(colour, _COLOURS) == _COLOURS - 1
    return last if part == "apart" else ~last
