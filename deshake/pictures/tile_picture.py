"""A photo with the tiles that its kernel was estimated from, and the local filters on them.

The tiles are those that the estimate chooses for its final kernel, at the finest scale that the
width of the kernel allows. A local filter, the blurred image of a point light, lies on every tile
that kernels are fitted to. If the kernel was read from streaks of lights, the picture shows the
streaks in place of tiles, each with its local filter beside it, at the same scale.
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
Points = NDArray[np.float64]
_Square = tuple[Points, Points]  # its upper left and its lower right corner, x and y

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


class _Marks(NamedTuple):
    """What is drawn on the photo: rectangles, filters on dark squares, and the legend."""

    fitted: list[_Square]
    apart: list[_Square]
    kernel: RotationKernel
    centres: Points
    """Places of the filters in the frame of the kernel's camera."""
    squares: list[_Square]
    """Places of the filters in the picture."""
    reach: float | None
    """Pixels from the middle of a filter to its border; None: as the filters need."""
    entries: list[tuple[Colour, str]]


def tile_photo(
    photo: Photo,
    kernel: RotationKernel,
    camera: Camera,
    region: Region | None = None,
    streaks: Points | None = None,
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
    streaks : (T, 4) array, optional
        Places of the streaks that the kernel was read from: x, y, width and height.

    """
    straight, pinhole = straightened(photo, camera)
    drawn = tile_picture(
        luminance(straight.pixels),
        pinhole,
        straight_kernel(kernel, camera, pinhole),
        straight_region(region, camera, pinhole),
        clipped=straight.clipped,
        streaks=streaks,
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
    streaks: Points | None = None,
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
    streaks : (T, 4) array, optional
        Places of the streaks that the kernel was read from: x, y, width and height in pixels of the
        photo. Then they are drawn in place of tiles.

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
    shrink = min(1.0, _LONGEST / max(height, width))
    size = max(round(width * shrink), 1), max(round(height * shrink), 1)
    ratio = np.array(size) / (width, height)
    whole = kernel.camera if kernel.camera.is_uniform else camera
    if streaks is None:
        x, y, w, h = region or (0, 0, width, height)
        part = np.s_[y : y + h, x : x + w]
        hidden = None if clipped is None else clipped[part]
        pyramid = Pyramid(grey[part], whole.cropped(x, y, w, h), hidden)
        marks = _of_tiles(pyramid, kernel, ratio * (x, y), ratio * (w, h))
    else:
        marks = _of_streaks(kernel.for_camera(whole), streaks, ratio)
    text = max(9.0, 0.014 * max(size))
    lines = _laid_out(marks.entries, text, size[0])
    canvas = Canvas(size[0], size[1] + round((1.6 * len(lines) + 0.8) * text))
    canvas.picture((0, 0), _display(grey, size))
    thickness = max(1.0, 0.0015 * max(size))
    _outline(canvas, marks.apart, _APART, thickness)
    if not marks.kernel.is_still:
        _draw_filters(canvas, marks)
    _outline(canvas, marks.fitted, _FITTED, thickness)
    for row, line in enumerate(lines):
        _draw_legend(canvas, line, text, size[1] + (1.6 * row + 1.2) * text)
    return canvas.finished()


def _of_tiles(pyramid: Pyramid, kernel: RotationKernel, origin: Points, extent: Points) -> _Marks:
    """Mark the tiles of an estimate, in a picture that shows its region at a place, so large."""
    level, scaled = _finest(pyramid, kernel)
    fitted = planned_tiles(pyramid, level, scaled)
    apart = planned_tiles(pyramid, level, scaled, part="apart")
    zoom = extent / scaled.camera.shape[::-1]

    def squares(tiles: Tiles) -> list[_Square]:
        lows = tiles.corners[:, ::-1].astype(np.float64)
        return [(origin + zoom * low, origin + zoom * (low + tiles.size)) for low in lows]

    entries = [
        (_FITTED, f"{fitted.count} tiles that the kernel is fitted to"),
        (_APART, f"{apart.count} tiles kept apart to judge it"),
    ]
    on_tiles = squares(fitted)
    centres = np.asarray(fitted.centres, np.float64)
    return _Marks(on_tiles, squares(apart), scaled, centres, on_tiles, None, entries)


def _of_streaks(kernel: RotationKernel, streaks: Points, ratio: Points) -> _Marks:
    """Mark streaks of lights, each with a square for its filter to the right or to the left."""
    lows, sizes = streaks[:, :2], streaks[:, 2:]
    side = float(sizes.max())
    middles = lows[:, 1:] + sizes[:, 1:] / 2 - side / 2
    right, left = lows[:, :1] + sizes[:, :1], lows[:, :1] - side
    beside = np.hstack(
        [np.where(right + side <= kernel.camera.width, right, np.maximum(left, 0)), middles]
    )
    boxes = [(ratio * low, ratio * (low + size)) for low, size in zip(lows, sizes, strict=True)]
    squares = [(ratio * low, ratio * (low + side)) for low in beside]
    words = f"{len(streaks)} streaks of lights that the kernel is read from, and its filters beside"
    centres: Points = lows + sizes / 2
    return _Marks(boxes, [], kernel, centres, squares, side / 2 - 1, [(_FITTED, words)])


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


def _draw_filters(canvas: Canvas, marks: _Marks) -> None:
    """Draw a kernel's local filters on dark squares, all at one scale."""
    backwards = homographies(marks.kernel.camera, -marks.kernel.theta)
    offsets = displacements(backwards, marks.centres)
    offsets -= (offsets.min(1, keepdims=True) + offsets.max(1, keepdims=True)) / 2
    reach = marks.reach or max(_LEAST_REACH, _MARGIN * float(np.abs(offsets).max()))
    ground = np.full((1, 1), _DARKENED)
    for (low, high), moved in zip(marks.squares, offsets, strict=True):
        square = low, (high[0], low[1]), (low[0], high[1])
        canvas.shade(ground, square, _DARK)
        side = max(3, round(float((high - low).max())))
        canvas.shade(point_light(moved, marks.kernel.weights, reach, side), square, _LIGHT)


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
