"""The light of a streak: what the photo shows in a square around it.

A streak is found by its brightest part. Its fainter parts, where the camera moved fast, say as much
of the path. So all connected light counts that is brighter than the surroundings. Other lights
nearby do not count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.blind.streaks import BLOCK, Streak
from deshake.geometry.rotations import displacements, grid_steps, homographies

if TYPE_CHECKING:
    from deshake.signal.pyramid import Scale

__all__ = ["SIDE", "StreakLight", "light_of"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Points = NDArray[np.float64]

SIDE = 96
"""Side in pixels of the square around a streak."""

_S: Final = SETTINGS.streak_light


class StreakLight(NamedTuple):
    """The light of a streak, without that of its surroundings.

    Parameters
    ----------
    picture : (96, 96) array of float32
        The light of the streak; 0 elsewhere.
    square : (int, int)
        Place of the square in the frame of the scale, x and y.
    corner : (int, int)
        Place of the part of the square that counts, x and y: the streak and its surroundings.
    light : (h, w) array
        The light of that part, relative to the surroundings.
    counted : (h, w) array of bool
        Which of its pixels count. The others show other lights, or are not near the streak.
    clipped : (h, w) array of bool
        Which of its pixels are clipped. There the light is at least `white`.
    white : float
        Light at which the photo clips, relative to the surroundings.
    moves : (2, 3) array
        Pixels by which the picture of the lamp moves per grid step about each axis: x and y.
    is_whole : bool
        Whether the whole streak lies in the square and in the frame.

    """

    picture: Image
    square: tuple[int, int]
    corner: tuple[int, int]
    light: Points
    counted: Mask
    clipped: Mask
    white: float
    moves: Points
    is_whole: bool

    @property
    def area(self) -> int:
        """Number of pixels that are clearly lit."""
        return max(int((self.light[self.counted] > _S.lit).sum()), 1)


def light_of(streak: Streak, scale: Scale) -> StreakLight | None:
    """Return the light of a streak; None if it does not stand out from its surroundings."""
    pixels, clipped, piece, (x, y) = _square(streak, scale)
    inside = np.isfinite(pixels)
    first = _grown(piece, _S.ring[0])
    ring = _grown(first, _S.ring[1] - _S.ring[0]) & ~first & inside
    if not ring.any():
        return None
    ground = float(np.median(pixels[ring]))
    spread = float(np.quantile(pixels[ring], _S.bright_part)) - ground
    lit = inside & (pixels - ground > max(_S.least_light, _S.contrast * spread))
    labels = np.asarray(cv2.connectedComponents(lit.astype(np.uint8), connectivity=8)[1])
    own = np.isin(labels, np.unique(labels[piece & lit]))
    if not own.any():
        return None
    counted = _grown(own, _S.around) & inside & ~(_grown(lit & ~own, 1) & ~own)
    light = np.where(inside, pixels - np.float32(ground), 0)
    left, top, width, height = cv2.boundingRect(counted.astype(np.uint8))
    part = np.s_[top : top + height, left : left + width]
    middle = np.array([[x + SIDE / 2, y + SIDE / 2]])
    unit = np.diag(grid_steps(scale.camera))
    moves = -displacements(homographies(scale.camera, unit), middle)[0].T
    edge = np.ones_like(own)
    edge[1:-1, 1:-1] = False
    return StreakLight(
        np.where(own, np.clip(light, 0, 1), 0).astype(np.float32),
        (x, y),
        (left, top),
        light[part].astype(np.float64),
        counted[part],
        (clipped | (pixels >= _S.white))[part],
        1 - ground,
        moves,
        not (own & (edge | _grown(~inside, 1))).any(),
    )


def _square(streak: Streak, scale: Scale) -> tuple[Image, Mask, Mask, tuple[int, int]]:
    """Cut out the square of a streak: light, clipped pixels, its bright piece, its place (x, y).

    Beyond the frame the light is not a number.
    """
    rows, columns = np.nonzero(streak.piece)
    left, top = (round(middle - BLOCK / 2) for middle in streak.centre)
    x = round(left + columns.mean()) - SIDE // 2
    y = round(top + rows.mean()) - SIDE // 2
    height, width = scale.stored.shape
    part = np.s_[max(y, 0) : min(y + SIDE, height), max(x, 0) : min(x + SIDE, width)]
    place = np.s_[
        part[0].start - y : part[0].stop - y,
        part[1].start - x : part[1].stop - x,
    ]
    pixels = np.full((SIDE, SIDE), np.nan, np.float32)
    pixels[place] = scale.piece(part)
    clipped = np.zeros((SIDE, SIDE), bool)
    if scale.clipped is not None:
        clipped[place] = scale.clipped[part]
    piece = np.zeros((SIDE, SIDE), bool)
    piece[rows + top - y, columns + left - x] = True
    return pixels, clipped, piece, (x, y)


def _grown(mask: Mask, radius: int) -> Mask:
    """Add all pixels within a distance."""
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), disk) > 0)
