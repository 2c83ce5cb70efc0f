"""Restore tiles with a sparse prior of gradients, ``sum |grad f|^0.8``.

The picture is that of the whole scene, not only of its strong edges. It is restored by
half-quadratic splitting, with few steps: it serves to compare kernels, and tones.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.signal.gradients import differences, length_of
from deshake.signal.shrinkage import shrunk

if TYPE_CHECKING:
    from deshake.blind.tiles import Tiles

__all__ = ["gradient_price", "restored"]

Image = NDArray[np.float32]

_S: Final = SETTINGS.restored_tiles


def gradient_price(tiles: Tiles) -> float:
    """Return the price of a gradient in the prior, from the photo and its noise."""
    length = length_of(*differences(tiles.g))[tiles.inside]
    noise = max(2 * tiles.noise, _S.least_noise)
    return _S.prior * noise**2 / (_S.power * float((length**_S.power).mean()))


def restored(tiles: Tiles, price: float) -> Image:
    """Restore tiles that are bound to a kernel.

    Parameters
    ----------
    tiles : Tiles
        The tiles.
    price : float
        Price of a gradient: `gradient_price`.

    Returns
    -------
    (P, N, N) array of float32
        The pictures, in the contrast of the pyramid, less the means of the tiles.

    """
    pictures = np.empty_like(tiles.g)
    for part, group in tiles.groups():
        pictures[part] = _restored_group(group, price)
    return pictures


def _restored_group(tiles: Tiles, price: float) -> Image:
    """Restore a few tiles."""
    picture, data = tiles.g, tiles.data()
    for stage, beta in enumerate(np.geomspace(*_S.penalties, _S.stages).tolist()):
        if stage == _S.fill_at:
            tiles.fill(picture)
            data = tiles.data()
        across, down = differences(picture)
        share = shrunk(length_of(across, down), price / beta, _S.power)
        picture = tiles.solved(data, across * share, down * share, beta)
    return picture
