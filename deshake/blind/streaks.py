"""The streaks that small lights draw on a photo, and which of them show the same path.

A lamp much brighter than its surroundings leaves a streak, which is the local filter of the blur at
its place. A streak is compact, thin, and dark around. Light beyond the clip level is not counted,
so only its shape is used.

A lamp, a window or a reflection has a shape of its own. So a streak counts only if others agree
with it. The streak of a weaker lamp shows those parts of the path alone where the camera moved
slowly: two streaks agree if the ridge of the shorter one lies on the longer one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

if TYPE_CHECKING:
    from deshake.signal.pyramid import Scale

__all__ = ["BLOCK", "Streak", "agreeing", "find_streaks"]

Image = NDArray[np.float32]

BLOCK = 64
"""Side in pixels of a streak's square."""

_LEVELS = (0.9, 0.6, 0.35)  # light: streaks are pieces that are brighter than this
_MOST_PIECES = 300  # of a level; more of them are texture
_LEAST_SIDE, _LONGEST_SIDE = 7, 44  # px of the scale: longer side of a streak's box
_LEAST_AREA = 10  # px
_DARK = 0.25  # light around a streak, as a share of the level, at most
_PEAK = 0.9  # light of the brightest pixel of a streak, at least
_DARK_PART = 0.75  # share of the surroundings that is so dark
_RING = 3  # px: width of the surroundings
_FILLED = 0.6  # share of its box that a spot or a surface fills
_SLENDER = 2.2  # ratio of the axes of a straight streak, which fills its box, too
_FULL = 0.8  # share of the brightest light of a streak that counts as 1
_MOST = 24  # streaks; more of them tell no more
_FEWEST = 3  # streaks that agree, at least
_FEWEST_LONG = 2  # of them, that show the whole path
_RIDGE = 0.7  # share of the largest distance from the border, nearby
_COVERED = 0.8  # share of a ridge that lies on the longer streak
_SHORTEST = 0.35  # of the length of the longest; a shorter streak agrees with everything
_LONG = 0.6  # of the length of the longest; a shorter streak lacks a part of the path
_THICK = 1.6  # of the median thickness; a thicker one is that of a large light
_WIDTH, _LEAST_WIDTH = 0.5, 0.6  # sigma of the light across a streak, per px of thickness; px
_NEAR = np.ones((3, 3), np.uint8)
_AROUND = np.ones((5, 5), np.uint8)


class Streak(NamedTuple):
    """A streak in a square of 64 x 64 pixels.

    Parameters
    ----------
    centre : (float, float)
        The middle of the square in the frame, x and y in pixels.
    light : (64, 64) array of float32
        Its light without that of the surroundings; the sum is 1.
    ridge : (64, 64) array of uint8
        Its middle line, 1 or 0.
    thickness : float
        Ratio of its area to that of the ridge.
    sigma : float
        Standard deviation of its light across the path, in pixels.

    """

    centre: tuple[float, float]
    light: Image
    ridge: NDArray[np.uint8]
    thickness: float
    sigma: float


def find_streaks(scale: Scale) -> list[Streak]:
    """Find the streaks in one scale of a photo, the brightest first."""
    bright = scale.picture
    if scale.usable is not None:  # clipped
        bright = np.where(scale.usable, bright, np.maximum(bright, 1)).astype(np.float32)
    bright = np.asarray(cv2.medianBlur(np.ascontiguousarray(bright), 3), np.float32)
    taken = np.zeros(bright.shape, bool)
    streaks: list[tuple[float, Streak]] = []
    for level in _LEVELS:
        mask = (bright > level).astype(np.uint8)
        if not mask.any():
            continue
        _, marked, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        labels = np.asarray(marked, np.int32)
        longer = boxes[:, 2:4].max(1)
        fits = (longer >= _LEAST_SIDE) & (longer <= _LONGEST_SIDE) & (boxes[:, 4] >= _LEAST_AREA)
        pieces = np.flatnonzero(fits[1:]) + 1  # 0 is the ground
        if len(pieces) > _MOST_PIECES:
            break
        for piece in pieces:
            x, y, w, h = boxes[piece, :4].tolist()
            inside = np.s_[y : y + h, x : x + w]
            if taken[inside].any():
                continue
            streak = _streak(bright, labels, int(piece), (x, y, w, h), level)
            if streak is not None:
                taken[inside] = True
                streaks.append((float(bright[inside].max()) * level, streak))
    streaks.sort(key=lambda item: -item[0])
    return [streak for _, streak in streaks[:_MOST]]


def agreeing(streaks: list[Streak]) -> tuple[list[Streak], NDArray[np.int64]]:
    """Return the long streaks of the largest set that agrees.

    Parameters
    ----------
    streaks : list of Streak
        All streaks.

    Returns
    -------
    streaks : list of Streak
        The longest streak of the set comes first. Empty: fewer than three streaks agree.
    shifts : (n, 2) array of int
        Row and column by which each streak moves onto the first one, in pixels.

    """
    none: list[Streak] = []
    if len(streaks) < _FEWEST:
        return none, np.zeros((0, 2), np.int64)
    ridges = np.stack([streak.ridge for streak in streaks])
    length = ridges.sum((1, 2)).astype(np.float64)
    thickness = np.array([streak.thickness for streak in streaks])
    thin = thickness <= _THICK * np.median(thickness)
    square = 2 * BLOCK, 2 * BLOCK
    wide = np.stack([cv2.dilate(ridge, _AROUND) for ridge in ridges]).astype(np.float32)
    narrow = np.conj(scipy.fft.rfft2(ridges.astype(np.float32), square, workers=1))
    most, best = 0.0, (none, np.zeros((0, 2), np.int64))
    for first in np.flatnonzero(thin):
        spectrum = scipy.fft.rfft2(wide[first], square, workers=1)
        match = scipy.fft.irfft2(spectrum * narrow, square, workers=1).reshape(len(streaks), -1)
        on_it = match.max(1) > _COVERED * length
        votes = int((on_it & (length > _SHORTEST * length[first])).sum())
        rank = votes + length[first] / BLOCK**2
        if votes < _FEWEST or rank <= most:
            continue
        others = np.flatnonzero(on_it & thin & (length > _LONG * length[first]))
        members = np.concatenate([[first], others[others != first]])
        if len(members) < _FEWEST_LONG:
            continue
        shifts = np.stack(np.unravel_index(match[members].argmax(1), square), 1)
        shifts = (shifts + BLOCK) % (2 * BLOCK) - BLOCK
        shifts[0] = 0
        most, best = rank, ([streaks[member] for member in members], shifts)
    return best


def _streak(
    bright: Image,
    labels: NDArray[np.int32],
    number: int,
    box: tuple[int, int, int, int],
    level: float,
) -> Streak | None:
    """Return a piece as a streak; None: it is not dark around it, or it is a spot or a surface."""
    x, y, w, h = box
    height, width = bright.shape
    top, left = y - _RING, x - _RING
    if top < 0 or left < 0 or y + h + _RING > height or x + w + _RING > width:
        return None
    around = np.s_[top : y + h + _RING, left : x + w + _RING]
    piece = (labels[around] == number).astype(np.uint8)
    ground = bright[around][cv2.dilate(piece, _AROUND) == 0]
    if not ground.size or np.quantile(ground, _DARK_PART) > _DARK * level:
        return None
    if bright[around][piece > 0].max() < _PEAK:
        return None
    spread = np.cov(np.stack(np.nonzero(piece)).astype(np.float64)) + np.eye(2) / 12
    shorter, longer = np.sqrt(np.linalg.eigvalsh(spread))
    if piece.sum() > _FILLED * w * h and longer < _SLENDER * shorter:
        return None
    light = (bright[around] - np.float32(np.median(ground))) * cv2.dilate(piece, _NEAR)
    light = np.clip(light / np.float32(_FULL * light.max()), 0, 1)
    inner = cv2.distanceTransform(piece, cv2.DIST_L2, 3)
    ridge = inner > _RIDGE * np.maximum(cv2.dilate(inner, _AROUND), 1)
    row, column = ((BLOCK - side) // 2 for side in light.shape)
    place = np.s_[row : row + light.shape[0], column : column + light.shape[1]]
    squares = np.zeros((BLOCK, BLOCK), np.float32), np.zeros((BLOCK, BLOCK), np.uint8)
    squares[0][place] = light / light.sum()
    squares[1][place] = ridge
    return Streak(
        (left - column + BLOCK / 2, top - row + BLOCK / 2),
        *squares,
        float(piece.sum() / max(ridge.sum(), 1)),
        max(_WIDTH * float(np.median(inner[ridge])) if ridge.any() else 0.0, _LEAST_WIDTH),
    )
