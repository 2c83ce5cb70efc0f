"""The sharp picture that belongs to a kernel, as gradients over the whole frame (Fig. 4)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.settings import SETTINGS, Budget
from deshake.blind.sharp_edges import l0_picture
from deshake.blind.tile_plan import planned_tiles
from deshake.signal.gradients import differences

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel
    from deshake.signal.pyramid import Pyramid

__all__ = ["latent_gradients"]

_NO_LIMIT = 1e12  # pixels, more than the blocks of any photo have

_S: Final = SETTINGS.latent_picture


def latent_gradients(pyramid: Pyramid, kernel: RotationKernel) -> NDArray[np.float32]:
    """Estimate the sharp picture of a kernel from edges, at a scale that takes about a second.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    kernel : RotationKernel
        A kernel for the camera of the photo.

    Returns
    -------
    (2, h, w) array of float32
        Differences to the right and to the lower neighbour, in linear light, in the kernel's frame.

    """
    level = pyramid.level_of(_S.largest)
    while level < pyramid.coarsest and (
        kernel.for_camera(pyramid.camera_at(level)).extent_px() > _S.widest
    ):
        level += 1
    scale = pyramid.at(level)
    scaled = kernel.for_camera(scale.camera)
    everything = Budget(0.0, float(scale.picture.size), _NO_LIMIT)
    tiles = planned_tiles(pyramid, level, scaled, part="all", budget=everything)
    tiles.bind(scaled)
    for _ in range(2):
        picture, _, _ = l0_picture(tiles, _S.price)
        tiles.fill(picture)
    gradients = np.zeros((2, *scale.picture.shape), np.float32)
    inner = slice(tiles.first, tiles.first + tiles.size)
    for axis, blocks in enumerate(differences(picture)):
        for (y, x), block in zip(tiles.corners, blocks, strict=True):
            gradients[axis, y : y + tiles.size, x : x + tiles.size] = block[inner, inner]
    gradients /= np.float32(scale.contrast)
    return gradients
