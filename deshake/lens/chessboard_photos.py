"""A camera file from photos of a chessboard: ``calibrate --chessboard`` runs this."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from deshake.errors import DeshakeError, EstimationError, PhotoError
from deshake.files.disk import check_output
from deshake.files.kernel_file import CameraFile, write_camera
from deshake.formats.photo import read_photo
from deshake.formats.transfer import SRGB, encode
from deshake.lens.chessboard import BoardCamera, Corners, board_camera, find_board
from deshake.run import Run
from deshake.signal.luminance import luminance

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

__all__ = ["ChessboardCalibration", "calibrate_from_chessboards"]

_log = logging.getLogger(__name__)

_REACH = 0.8  # share of half the diagonal: boards that reach less far get a note
_LARGE_PX = 1.0  # px of error: above it a note; good calibrations have a third of it


@dataclass(frozen=True, eq=False)
class ChessboardCalibration:
    """A camera measured from photos of a board.

    Parameters
    ----------
    content : CameraFile
        The camera and its source in words.
    fit : BoardCamera
        How well it explains the photos.
    photos : list of Path
        The photos.
    notes : list of str
        What the user should know.

    """

    content: CameraFile
    fit: BoardCamera
    photos: list[Path]
    notes: list[str]

    def report(self) -> dict[str, Any]:
        """Return the figures as JSON data."""
        camera = self.fit.camera
        return {
            "inputs": [str(path) for path in self.photos],
            "focal_px": round(camera.focal_px, 3),
            "focal_sigma_px": round(self.fit.focal_sigma_px, 3),
            "principal_point": np.round(camera.matrix[:2, 2], 3).tolist(),
            "distortion": camera.distortion.tolist(),
            "source": self.content.source,
            "error_px": round(self.fit.error_px, 4),
            "errors_px": np.round(self.fit.errors_px, 4).tolist(),
            "notes": self.notes,
            "width": camera.width,
            "height": camera.height,
        }


def calibrate_from_chessboards(
    photos: Sequence[Path],
    output: Path | None,
    board: tuple[int, int],
    *,
    overwrite: bool = False,
    run: Run = Run(),
) -> ChessboardCalibration:
    """Estimate a camera from photos of a printed board; write its file if `output` is given.

    Parameters
    ----------
    photos : sequence of Path
        Photos of one board by one camera at one focal length.
    output : Path, optional
        The camera file, or "-" for standard output.
    board : (int, int)
        Inner corners along and across the board.
    overwrite : bool
        Whether an existing file may be replaced.
    run : Run, optional
        Receives the progress.

    Raises
    ------
    PhotoError
        If a photo cannot be read, or the photos differ in size.
    EstimationError
        If a photo does not show the board, or for the reasons of `board_camera`.
    OutputError
        If the camera file cannot be written.

    """
    if output is not None:
        check_output(output, *photos, overwrite=overwrite)
    boards, shape = _corners(photos, board, run)
    try:
        fit = board_camera(boards, board, *shape)
    except DeshakeError as error:
        error.file = error.file or ", ".join(map(str, photos))
        raise
    size = f"{board[0]}x{board[1]}"
    source = f"chessboard of {size} corners, {len(boards)} photos, error {fit.error_px:.2f} pixels"
    notes = []
    if fit.error_px > _LARGE_PX:
        notes.append(
            f"the corners are off by {fit.error_px:.1f} pixels: is the board flat, and are the "
            "photos sharp?"
        )
    if fit.reach < _REACH:
        notes.append(
            "no photo shows the board near the corners of the frame: the distortion there is a "
            "guess"
        )
    result = ChessboardCalibration(CameraFile(fit.camera, source), fit, list(photos), notes)
    for note in notes:
        _log.warning("%s", note)
    if output is not None:
        write_camera(output, result.content, overwrite=overwrite, made_from=photos)
    return result


def _corners(
    photos: Sequence[Path], board: tuple[int, int], run: Run
) -> tuple[list[Corners], tuple[int, int]]:
    """Detect the board in all photos; return its corners, and the size of the photos."""
    boards: list[Corners] = []
    missing: list[Path] = []
    first: tuple[int, int] | None = None
    for number, path in enumerate(photos):
        run.report(number / len(photos), f"looking for the board in {path.name}")
        photo = read_photo(path)
        first = first or photo.shape
        if photo.shape != first:
            size, other = (f"{w} x {h}" for h, w in (photo.shape, first))
            raise PhotoError(
                f"it has {size} pixels, and {photos[0]} has {other}",
                hint="all photos of the board must be of one size, and taken the same way up",
                file=path,
            )
        grey = np.asarray(encode(luminance(photo.pixels), SRGB, 8), np.uint8)
        corners = find_board(grey, board)
        if corners is None:
            missing.append(path)
        else:
            boards.append(corners)
    if missing or first is None:
        raise EstimationError(
            f"no board of {board[0]}x{board[1]} inner corners is seen in "
            + ", ".join(map(str, missing)),
            hint="the whole board must be seen, with a white margin; --board counts the corners "
            "where four squares meet, 9x6 for 10 x 7 squares; leave bad photos out",
        )
    return boards, first
