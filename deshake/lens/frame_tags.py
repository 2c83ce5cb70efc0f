"""EXIF tags of the frame, corrected for a picture that was cropped or straightened."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from deshake.lens.focal_length import FULL_FRAME_DIAGONAL
from deshake.metadata import exif

if TYPE_CHECKING:
    from deshake.metadata.metadata import Metadata

__all__ = ["reframed"]

_PIXELS: Final = (0xA002, 0xA003)
_FOCAL_PLANE: Final = (0xA20E, 0xA20F)
_UNIT: Final = 0xA210
_CENTIMETRES: Final = 3
_ZOOM: Final = 0xA404
_EQUIVALENT: Final = 0xA405
_FINE: Final = 10_000  # the denominator of resolutions


def reframed(metadata: Metadata, height: int, width: int, focal_px: float) -> Metadata:
    """Return metadata whose EXIF states the frame of a picture.

    PixelXDimension and PixelYDimension become the size of the picture. The focal plane resolution
    becomes the ratio of the focal length in pixels to FocalLength. If FocalLength is missing,
    FocalLengthIn35mmFilm becomes the equivalent, rounded to 1 mm; else that tag is removed, since
    it is too coarse. The bytes that the camera wrote keep their offsets: the changed directories
    are appended. The link to a thumbnail is removed. Metadata without EXIF, or with no room for
    more, stay unchanged.

    Parameters
    ----------
    metadata : Metadata
        Metadata of the picture as it was taken.
    height, width : int
        The picture's size in pixels.
    focal_px : float
        Its focal length in pixels.

    """
    first = exif.read_first(metadata.exif)
    if first is None or exif.read_below(metadata.exif, first, exif.EXIF_POINTER) is None:
        return metadata
    tree = exif.read_tree(metadata.exif)
    tags = metadata.tags()
    order = tree.order
    for tag, side in zip(_PIXELS, (width, height), strict=True):
        tree.exif[tag] = 4, 1, struct.pack(f"{order}I", side)
    tree.exif.pop(_ZOOM, None)
    for tag in (*_FOCAL_PLANE, _UNIT):
        tree.exif.pop(tag, None)
    if tree.exif.pop(_EQUIVALENT, None) is not None and tags.focal_mm is None:
        film = round(focal_px * FULL_FRAME_DIAGONAL / math.hypot(height, width))
        tree.exif[_EQUIVALENT] = 3, 1, struct.pack(f"{order}H", min(max(film, 1), 65535))
    if tags.focal_mm is not None:
        resolution = min(round(10 * _FINE * focal_px / tags.focal_mm), 0xFFFFFFFF)
        for tag in _FOCAL_PLANE:
            tree.exif[tag] = 5, 1, struct.pack(f"{order}II", resolution, _FINE)
        tree.exif[_UNIT] = 3, 1, struct.pack(f"{order}H", _CENTIMETRES)
    block = exif.append_tree(metadata.exif, tree)
    return metadata if len(block) > exif.LONGEST else replace(metadata, exif=block)
