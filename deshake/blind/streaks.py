"""The streaks that small lights draw on a photo, and which of them show the same path.

A lamp much brighter than its surroundings leaves a streak, which is the local filter of the blur at
its place. A streak is small and thin, and its surroundings are dark. The sensor clips bright light,
so only the shape of a streak is used.

A lamp, a window or a reflection has a shape of its own. So a streak counts only if others agree
with it. The streak of a weaker lamp shows only the parts of the path where the camera moved slowly.
So two streaks agree if the ridge of the shorter one lies on the longer one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS

if TYPE_CHECKING:
    from deshake.signal.pyramid import Scale

__all__ = ["BLOCK", "Streak", "agreeing", "find_streaks"]

Image = NDArray[np.float32]

BLOCK = 64
"""Side in pixels of a streak's square."""

_S: Final = SETTINGS.streaks
_AROUND = np.ones((5, 5), np.uint8)


class Streak(NamedTuple):
    """A streak in a square of 64 x 64 pixels.

    Parameters
    ----------
    centre : (float, float)
        The middle of the square in the frame, x and y in pixels.
    piece : (64, 64) array of uint8
        Its bright pixels, 1 or 0.
    ridge : (64, 64) array of uint8
        Its middle line, 1 or 0.
    thickness : float
        Ratio of its area to that of the ridge.

    """

    centre: tuple[float, float]
    piece: NDArray[np.uint8]
    ridge: NDArray[np.uint8]
    thickness: float


def find_streaks(scale: Scale) -> list[Streak]:
    """Find the streaks in one scale of a photo, ordered by peak times threshold."""
    bright = scale.picture
    if scale.clipped is not None:  # clipped pixels count as at least 1
        bright = np.where(scale.clipped, np.maximum(bright, 1), bright).astype(np.float32)
    bright = np.asarray(cv2.medianBlur(np.ascontiguousarray(bright), 3), np.float32)
    taken = np.zeros(bright.shape, bool)
    streaks: list[tuple[float, Streak]] = []
    for level in _S.levels:
        mask = (bright > level).astype(np.uint8)
        if not mask.any():
            continue
        _, marked, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        labels = np.asarray(marked, np.int32)
        longer = boxes[:, 2:4].max(1)
        fits = (
            (longer >= _S.least_side) & (longer <= _S.longest_side) & (boxes[:, 4] >= _S.least_area)
        )
        pieces = np.flatnonzero(fits[1:]) + 1  # label 0 is the background
        if len(pieces) > _S.most_pieces:
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
    return [streak for _, streak in streaks[: _S.most]]


def agreeing(streaks: list[Streak]) -> list[Streak]:
    """Return the long streaks of the largest set that agrees.

    The first streak is the one that the others lie on. The list is empty if too few streaks agree,
    or if too few of them are long and thin.
    """
    if len(streaks) < _S.fewest:
        return []
    ridges = np.stack([streak.ridge for streak in streaks])
    length = ridges.sum((1, 2)).astype(np.float64)
    thickness = np.array([streak.thickness for streak in streaks])
    thin = thickness <= _S.thick * np.median(thickness)
    square = 2 * BLOCK, 2 * BLOCK
    wide = np.stack([cv2.dilate(ridge, _AROUND) for ridge in ridges]).astype(np.float32)
    narrow = np.conj(scipy.fft.rfft2(ridges.astype(np.float32), square, workers=1))
    most, best = 0.0, np.zeros(0, np.int64)
    for first in np.flatnonzero(thin):
        spectrum = scipy.fft.rfft2(wide[first], square, workers=1)
        match = scipy.fft.irfft2(spectrum * narrow, square, workers=1).reshape(len(streaks), -1)
        on_it = match.max(1) > _S.covered * length
        votes = int((on_it & (length > _S.shortest * length[first])).sum())
        rank = votes + length[first] / BLOCK**2
        if votes < _S.fewest or rank <= most:
            continue
        others = np.flatnonzero(on_it & thin & (length > _S.long * length[first]))
        members = np.concatenate([[first], others[others != first]])
        if len(members) < _S.fewest_long:
            continue
        most, best = rank, members
    return [streaks[member] for member in best]


def _streak(
    bright: Image,
    labels: NDArray[np.int32],
    number: int,
    box: tuple[int, int, int, int],
    level: float,
) -> Streak | None:
    """Return a piece as a streak, or None if it is not a streak.

    A piece is not a streak if it is too near the border of the frame, if its surroundings are not
    dark, if its peak is too weak, or if it is a spot or a surface.
    """
    x, y, w, h = box
    height, width = bright.shape
    top, left = y - _S.ring, x - _S.ring
    if top < 0 or left < 0 or y + h + _S.ring > height or x + w + _S.ring > width:
        return None
    around = np.s_[top : y + h + _S.ring, left : x + w + _S.ring]
    piece = (labels[around] == number).astype(np.uint8)
    ground = bright[around][cv2.dilate(piece, _AROUND) == 0]
    if not ground.size or np.quantile(ground, _S.dark_part) > _S.dark * level:
        return None
    if bright[around][piece > 0].max() < _S.peak:
        return None
    spread = np.cov(np.stack(np.nonzero(piece)).astype(np.float64)) + np.eye(2) / 12
    shorter, longer = np.sqrt(np.linalg.eigvalsh(spread))
    if piece.sum() > _S.filled * w * h and longer < _S.slender * shorter:
        return None
    inner = cv2.distanceTransform(piece, cv2.DIST_L2, 3)
    ridge = inner > _S.ridge * np.maximum(cv2.dilate(inner, _AROUND), 1)
    row, column = ((BLOCK - side) // 2 for side in piece.shape)
    squares = np.zeros((2, BLOCK, BLOCK), np.uint8)
    squares[:, row : row + piece.shape[0], column : column + piece.shape[1]] = piece, ridge
    return Streak(
        (left - column + BLOCK / 2, top - row + BLOCK / 2),
        squares[0],
        squares[1],
        float(piece.sum() / max(ridge.sum(), 1)),
    )
