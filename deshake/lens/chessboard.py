"""A camera from photos of a chessboard: focal length, principal point and distortion.

OpenCV detects the inner corners of the board on a small copy, and refines them on the photo. A
least-squares fit over the camera and the positions of the boards explains all corners [1]_.

References
----------
.. [1] Z. Zhang, A flexible new technique for camera calibration, PAMI 22(11), 2000; OpenCV has it.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError
from deshake.geometry.camera import Camera

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["FEWEST", "BoardCamera", "Corners", "board_camera", "find_board"]

FEWEST: Final = 3
"""Photos that a calibration needs at least."""

_SEARCH_SIDE: Final = 1200  # px: longer side of the small copy; smaller photos are not resized
_WINDOW: Final = 0.25  # share of the distance between corners: half side of the refining window
_STOP: Final = (3, 60, 1e-4)  # TermCriteria: at most 60 iterations, or steps below 1e-4 px
_UNSURE: Final = 0.05  # share of the focal length: a larger standard deviation is an error
_TILTED: Final = np.radians(10)  # radians between two boards: less tilt is an error
_MANY: Final = 8  # photos: with fewer, which rarely reach all corners, k3 is 0
_WRONG: Final = 0.004  # share of the diagonal: a larger error of the corners is an error

Corners = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BoardCamera:
    """The camera estimated from photos of a board, and how well it explains them.

    Parameters
    ----------
    camera : Camera
        With its distortion: k1, k2, p1, p2, k3.
    error_px : float
        Root mean square distance between the detected corners and the camera's prediction.
    errors_px : list of float
        The same for each photo.
    focal_sigma_px : float
        Standard deviation of the focal length, from the fit.
    reach : float
        Distance of the outermost board corner from the middle, in shares of half the diagonal.

    """

    camera: Camera
    error_px: float
    errors_px: list[float]
    focal_sigma_px: float
    reach: float


def find_board(grey: NDArray[np.uint8], board: tuple[int, int]) -> Corners | None:
    """Detect the inner corners of a board.

    Parameters
    ----------
    grey : (h, w) array of uint8
        The photo, display values.
    board : (int, int)
        Inner corners along and across the board.

    Returns
    -------
    (N, 2) array of float64 or None
        Pixels (x, y), row by row; None if the photo does not show the whole board.

    """
    shrink = min(1.0, _SEARCH_SIDE / max(grey.shape))
    small = cv2.resize(grey, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    how = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    detected, peaks = cv2.findChessboardCornersSB(small, board, flags=how)
    if not detected:
        return None
    sizes = np.array(grey.shape[::-1]) / np.array(small.shape[::-1])
    corners: Corners = (np.asarray(peaks, np.float64).reshape(-1, 2) + 0.5) * sizes - 0.5
    if shrink == 1:
        return corners
    steps = np.linalg.norm(np.diff(corners.reshape(board[1], board[0], 2), axis=1), axis=-1)
    side = max(3, int(_WINDOW * steps.min()))
    start = corners.astype(np.float32).reshape(-1, 1, 2)
    fine = cv2.cornerSubPix(grey, start, (side, side), (-1, -1), _STOP)
    return np.asarray(fine, np.float64).reshape(-1, 2)


def board_camera(
    boards: Sequence[Corners], board: tuple[int, int], height: int, width: int
) -> BoardCamera:
    """Estimate the camera from the corners of a board in several photos.

    Parameters
    ----------
    boards : sequence of (N, 2) arrays
        From `find_board`, one for each photo.
    board : (int, int)
        Inner corners along and across the board.
    height, width : int
        Size of the photos in pixels.

    Raises
    ------
    EstimationError
        If there are fewer than `FEWEST` photos, the boards leave the focal length too uncertain,
        or no single board and camera explain the corners.

    """
    if len(boards) < FEWEST:
        raise EstimationError(
            f"{len(boards)} photos of a board are too few",
            hint=f"take {FEWEST} at the least, better 10 to 20, the board tilted in all directions",
        )
    columns, rows = board
    places = np.zeros((rows * columns, 3), np.float32)
    places[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2)
    corners = [np.float32(each).reshape(-1, 1, 2) for each in boards]
    error, matrix, lens, turns, _, sigmas, _, errors = cv2.calibrateCameraExtended(
        [places] * len(boards),
        corners,
        (width, height),
        np.eye(3),
        np.zeros(5),
        flags=0 if len(boards) >= _MANY else cv2.CALIB_FIX_K3,
    )
    focal = float(np.sqrt(matrix[0, 0] * matrix[1, 1])) if matrix[0, 0] * matrix[1, 1] > 0 else 0.0
    sigma = float(np.ravel(sigmas)[:2].max())
    if not (np.isfinite(error) and error < _WRONG * np.hypot(height, width)):
        raise EstimationError(
            f"the photos of the board do not fit one camera: corners are off by {error:.1f} pixels",
            hint="the board must be flat, and all photos of one camera at one focal length",
        )
    tilt = _tilts([np.asarray(turn, np.float64) for turn in turns])
    if not (focal > 0 and sigma < _UNSURE * focal and tilt > _TILTED):
        raise EstimationError(
            "the photos of the board are too much alike: tilted by "
            f"{np.degrees(tilt):.0f} degrees to each other, they leave the focal length uncertain "
            f"by {sigma:.0f} of {focal:.0f} pixels",
            hint="tilt the board by some 30 degrees in all directions, and fill the frame",
        )
    camera = Camera(np.asarray(matrix, np.float64), height, width, np.ravel(lens))
    middle = np.array([width - 1, height - 1]) / 2
    out = max(float(np.linalg.norm(each - middle, axis=1).max()) for each in boards)
    reach = out / float(np.linalg.norm(middle))
    return BoardCamera(camera, float(error), np.ravel(errors).tolist(), sigma, reach)


def _tilts(turns: Sequence[NDArray[np.floating]]) -> float:
    """Return the largest angle between the normals of two boards, in radians."""
    normals = np.stack([cv2.Rodrigues(np.asarray(turn))[0][:, 2] for turn in turns])
    return float(np.arccos(np.clip(normals @ normals.T, -1, 1)).max())
