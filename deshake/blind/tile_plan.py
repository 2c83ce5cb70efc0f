"""The places of tiles at a scale: tiles for the fit of kernels, and tiles kept apart for the judge.

The frame is a chessboard of three colours. Tiles whose centre lies on one of the colours are kept
apart. The judge uses only those. No kernel is fitted to them, unless the photo is so small that the
tiles cover all of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from deshake.blind.settings import SETTINGS
from deshake.blind.tile_choice import chosen, covering
from deshake.blind.tiles import Tiles
from deshake.geometry.rotations import reach

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.blind.settings import Budget
    from deshake.blind.tile_choice import Corners
    from deshake.geometry.kernel import RotationKernel
    from deshake.signal.pyramid import Pyramid

__all__ = ["Part", "informative_corners", "planned_tiles"]

Part = Literal["fitted", "apart", "all"]

_S: Final = SETTINGS.tile_plan


def planned_tiles(
    pyramid: Pyramid,
    level: int,
    kernel: RotationKernel,
    *,
    part: Part = "fitted",
    budget: Budget = _S.budget,
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
    most = max(int(budget.blocks / (size + 2 * far) ** 2), _S.fewest)
    covers = np.prod(scale.camera.shape) <= budget.frame
    corners = covering(scale.camera.shape, size)
    if not covers or len(corners) > most:
        count = most if covers else min(max(int(budget.tiles / size**2), _S.fewest), most)
        width = max(kernel.above(_S.cut).extent_px(), _S.narrow)
        corners = informative_corners(
            pyramid, level, size, count, width=width, part=part, isolated=True
        )
    return Tiles(scale, corners, size, far)


def informative_corners(
    pyramid: Pyramid,
    level: int,
    size: int,
    count: int,
    *,
    width: float,
    part: Part,
    isolated: bool = False,
) -> Corners:
    """Choose the most informative tiles of a part; see `tile_choice.chosen`."""
    return chosen(
        pyramid,
        level,
        size,
        count,
        width=width,
        allowed=lambda x, y: _belongs(_colour(x, y), part),
        isolated=isolated,
    )


def _size(theta: NDArray[np.float64], far: int, most: int) -> int:
    """Return an even tile size at which a rotation moves both ends of a tile nearly alike."""
    turn = float(np.ptp(theta, axis=0).max())
    least = max(_S.least, min(2 * far, _S.largest))
    size = min(int(np.clip(_S.turn / max(turn, 1e-9), least, _S.largest)), most)
    return size - size % 2


def _colour(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the colour of the chessboard at places in widths of the frame."""
    column, row = np.floor(x * _S.fields).astype(np.int64), np.floor(y * _S.fields).astype(np.int64)
    colour: NDArray[np.int64] = column + 2 * row
    return colour


def _belongs(colour: NDArray[np.int64] | int, part: Part) -> NDArray[np.bool_]:
    """Return whether a tile of a colour belongs to a part."""
    if part == "all":
        return np.ones_like(colour, bool)
    last: NDArray[np.bool_] = np.mod(colour, _S.colours) == _S.colours - 1
    return last if part == "apart" else ~last
