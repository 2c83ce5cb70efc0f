"""A photo with the tiles that its kernel was estimated from, and the local filters on them.

The tiles are those that the estimate chooses for its final kernel, at the finest scale that the
width of the kernel allows. A local filter, the blurred image of a point light, lies on every tile
that kernels are fitted to.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.settings import SETTINGS
from deshake.blind.tile_plan import planned_tiles
from deshake.formats.encoding import Encoding
from deshake.formats.transfer import SRGB, decode
from deshake.geometry.rotations import displacements, homographies
from deshake.lens.straightening import straight_kernel, straight_region, straightened
from deshake.metadata.metadata import Metadata
from deshake.pictures.canvas import Canvas, Colour, Picture, Point
from deshake.pictures.render import point_light
from deshake.signal.luminance import luminance
from deshake.signal.pyramid import Pyramid

if TYPE_CHECKING:
    from deshake.blind.tiles import Tiles
    from deshake.formats.photo import Photo
    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel

__all__ = ["tile_photo", "tile_picture"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Region = tuple[int, int, int, int]
_Square = tuple[NDArray[np.float64], NDArray[np.float64]]

_LONGEST = 1600  # px
_FITTED: Colour = (255, 150, 0)
_APART: Colour = (70, 160, 255)
_DARK: Colour = (10, 12, 18)
_LIGHT: Colour = (255, 255, 255)
_INK: Colour = (40, 44, 52)
_DARKENED = 0.7  # share of the photo's light that is hidden behind a filter
_LEAST_REACH = 3.0  # px around the middle of a filter
_MARGIN = 1.06  # between the farthest light and the border of its square
_LETTER = 0.55  # width of a letter, as a share of the text's size


class _Frame(NamedTuple):
    """Where the corners of a scale's pixels lie in the picture: ``origin + zoom * corner``."""

    origin: NDArray[np.float64]
    zoom: NDArray[np.float64]

    def corners(self, tiles: Tiles) -> list[_Square]:
        """Return the upper left and lower right corners (x, y) of tiles in the picture."""
        lows = tiles.corners[:, ::-1].astype(np.float64)
        highs = lows + tiles.size
        return [
            (self.origin + self.zoom * low, self.origin + self.zoom * high)
            for low, high in zip(lows, highs, strict=True)
        ]


def tile_photo(
    photo: Photo, kernel: RotationKernel, camera: Camera, region: Region | None = None
) -> Photo:
    """Draw the tiles on a photo: 8 bits, sRGB, no metadata.

    Parameters
    ----------
    photo : Photo
        The photo of the estimate. If its camera has a distortion, it is straightened, as for the
        estimate.
    kernel : RotationKernel
        The kernel of the estimate.
    camera : Camera
        The photo's camera.
    region : (x, y, width, height), optional
        The part of the photo that the estimate used, by default all of it.

    """
    straight, pinhole = straightened(photo, camera)
    drawn = tile_picture(
        luminance(straight.pixels),
        pinhole,
        straight_kernel(kernel, camera, pinhole),
        straight_region(region, camera, pinhole),
        clipped=straight.clipped,
    )
    return replace(
        photo,
        pixels=decode(drawn, SRGB),
        clipped=np.zeros(drawn.shape[:2], bool),
        alpha=None,
        encoding=Encoding("PNG"),
        metadata=Metadata(),
        frame=None,
    )


def tile_picture(
    grey: Image,
    camera: Camera,
    kernel: RotationKernel,
    region: Region | None = None,
    *,
    clipped: Mask | None = None,
) -> Picture:
    """Draw the tiles that a kernel was estimated from, and its local filters on them.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 0..1.
    camera : Camera
        Its camera. For a kernel of the uniform model, the kernel's own camera counts.
    kernel : RotationKernel
        The kernel of the estimate; a still camera has no filters to draw.
    region : (x, y, width, height), optional
        The part of the photo that the estimate used, by default all of it.
    clipped : (h, w) array of bool, optional
        Clipped pixels, which the estimate ignored.

    Returns
    -------
    (H, W, 3) array of uint8
        The photo in display values, reduced to 1600 pixels on the longer side, and a legend below.

    Raises
    ------
    EstimationError
        If the photo is flat.

    """
    height, width = grey.shape
    x, y, w, h = region or (0, 0, width, height)
    part = np.s_[y : y + h, x : x + w]
    whole = kernel.camera if kernel.camera.is_uniform else camera
    pyramid = Pyramid(
        grey[part], whole.cropped(x, y, w, h), None if clipped is None else ~clipped[part]
    )
    level, scaled = _finest(pyramid, kernel)
    fitted = planned_tiles(pyramid, level, scaled)
    apart = planned_tiles(pyramid, level, scaled, part="apart")

    shrink = min(1.0, _LONGEST / max(height, width))
    size = max(round(width * shrink), 1), max(round(height * shrink), 1)
    ratio = np.array(size) / (width, height)
    frame = _Frame(ratio * (x, y), ratio * (w, h) / scaled.camera.shape[::-1])
    text = max(9.0, 0.014 * max(size))
    entries = [
        (_FITTED, f"{fitted.count} tiles that the kernel is fitted to"),
        (_APART, f"{apart.count} tiles kept apart to judge it"),
    ]
    lines = _laid_out(entries, text, size[0])
    canvas = Canvas(size[0], size[1] + round((1.6 * len(lines) + 0.8) * text))
    canvas.picture((0, 0), _display(grey, size))
    thickness = max(1.0, 0.0015 * max(size))
    _outline(canvas, frame.corners(apart), _APART, thickness)
    if not scaled.is_still:
        _draw_filters(canvas, scaled, fitted, frame)
    _outline(canvas, frame.corners(fitted), _FITTED, thickness)
    for row, line in enumerate(lines):
        _draw_legend(canvas, line, text, size[1] + (1.6 * row + 1.2) * text)
    return canvas.finished()


def _finest(pyramid: Pyramid, kernel: RotationKernel) -> tuple[int, RotationKernel]:
    """Return the finest scale that the width of a kernel allows, and the kernel there."""
    way, level = SETTINGS.candidate.fine, 0
    while True:
        scaled = kernel.for_camera(pyramid.camera_at(level))
        if level == pyramid.coarsest or scaled.above(way.cut).extent_px() <= way.wide:
            return level, scaled
        level += 1


def _display(grey: Image, size: tuple[int, int]) -> Picture:
    """Reduce a photo to a size, and return its display values (h, w, 3)."""
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    codes = np.rint(255 * SRGB.from_linear(np.clip(small, 0, 1))).astype(np.uint8)
    return np.dstack([codes] * 3)


def _draw_filters(canvas: Canvas, kernel: RotationKernel, tiles: Tiles, frame: _Frame) -> None:
    """Draw a kernel's local filters, each in the middle of its tile, all at one scale."""
    backwards = homographies(kernel.camera, -kernel.theta)
    offsets = displacements(backwards, tiles.centres)
    offsets -= (offsets.min(1, keepdims=True) + offsets.max(1, keepdims=True)) / 2
    reach = max(_LEAST_REACH, _MARGIN * float(np.abs(offsets).max()))
    ground = np.full((1, 1), _DARKENED)
    for (low, high), moved in zip(frame.corners(tiles), offsets, strict=True):
        square = low, (high[0], low[1]), (low[0], high[1])
        canvas.shade(ground, square, _DARK)
        side = max(3, round(float((high - low).max())))
        canvas.shade(point_light(moved, kernel.weights, reach, side), square, _LIGHT)


def _outline(canvas: Canvas, squares: list[_Square], colour: Colour, thickness: float) -> None:
    """Draw the borders of upright rectangles."""
    for low, high in squares:
        corners: list[Point] = [low, (high[0], low[1]), high, (low[0], high[1])]
        for start, end in zip(corners, [*corners[1:], corners[0]], strict=True):
            canvas.line(start, end, colour, thickness)


def _laid_out(
    entries: list[tuple[Colour, str]], text: float, width: int
) -> list[list[tuple[Colour, str]]]:
    """Put a legend's entries side by side, or below each other where they do not fit."""
    along = sum((3 + _LETTER * len(words)) * text for _, words in entries)
    return [entries] if along <= width else [[entry] for entry in entries]


def _draw_legend(
    canvas: Canvas, entries: list[tuple[Colour, str]], text: float, middle: float
) -> None:
    """Write a line of the legend: a square of each colour, and what it stands for."""
    x = 0.6 * text
    for colour, words in entries:
        canvas.rectangle((x, middle - 0.4 * text), (x + 0.8 * text, middle + 0.4 * text), colour)
        canvas.text((x + 1.3 * text, middle), words, text, _INK, anchor="left")
        x += (3 + _LETTER * len(words)) * text
