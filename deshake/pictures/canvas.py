"""A small anti-aliased drawing surface: lines, discs, pictures, shades, and text with thetas.

Everything is drawn three times as large and averaged down at the end. Coordinates are pixels of
the finished picture, x right and y down, with (0, 0) at its upper left corner.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["Canvas", "Colour", "Picture", "Point"]

Colour: TypeAlias = tuple[int, int, int]
Point: TypeAlias = "Sequence[float] | NDArray[np.float64]"
Picture: TypeAlias = NDArray[np.uint8]

_SCALE = 3
_BITS = 4  # OpenCV's fixed-point fraction of a pixel
_THETA = re.compile("(θ_[XYZ])")
_THETA_WIDTH = 0.92  # of the font size, subscript included


class Canvas:
    """A picture being drawn.

    Parameters
    ----------
    width, height : int
        Size of the finished picture in pixels.
    background : (int, int, int)
        Red, green, blue.

    """

    def __init__(self, width: int, height: int, background: Colour = (255, 255, 255)) -> None:
        self._pixels: Picture = np.full(
            (height * _SCALE, width * _SCALE, 3), background, dtype=np.uint8
        )
        self._texts: list[tuple[float, float, str, float, Colour]] = []

    def finished(self) -> Picture:
        """Return the picture, (height, width, 3) uint8 RGB."""
        image = Image.fromarray(self._pixels)
        draw = ImageDraw.Draw(image)
        for x, y, text, size, colour in self._texts:
            place = (x * _SCALE, y * _SCALE)
            draw.text(place, text, fill=colour, font=_font(size * _SCALE), anchor="lm")
        return np.array(image.reduce(_SCALE))

    def line(self, start: Point, end: Point, colour: Colour, width: float = 1.0) -> None:
        """Draw a line, `width` pixels wide."""
        thickness = max(1, round(width * _SCALE))
        ends = _fixed(start), _fixed(end)
        cv2.line(self._pixels, *ends, colour, thickness, cv2.LINE_AA, _BITS)

    def polygon(self, corners: Sequence[Point], fill: Colour) -> None:
        """Fill a convex polygon."""
        points = np.array([_fixed(corner) for corner in corners], np.int32)
        cv2.fillConvexPoly(self._pixels, points, fill, cv2.LINE_AA, _BITS)

    def disc(self, centre: Point, radius: float, fill: Colour, edge: Colour | None = None) -> None:
        """Fill a disc, with a fine edge around it if a colour is given for one."""
        size = max(1, round(radius * _SCALE * (1 << _BITS)))
        cv2.circle(self._pixels, _fixed(centre), size, fill, cv2.FILLED, cv2.LINE_AA, _BITS)
        if edge is not None:
            cv2.circle(self._pixels, _fixed(centre), size, edge, 1, cv2.LINE_AA, _BITS)

    def rectangle(self, corner: Point, opposite: Point, fill: Colour) -> None:
        """Fill an upright rectangle."""
        (x0, y0), (x1, y1) = corner, opposite
        self.polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], fill)

    def picture(self, corner: tuple[int, int], pixels: Picture) -> None:
        """Lay a picture (h, w, 3) with its upper left pixel at (x, y), all of it on the canvas."""
        large = pixels.repeat(_SCALE, 0).repeat(_SCALE, 1)
        x, y = (_SCALE * place for place in corner)
        self._pixels[y : y + large.shape[0], x : x + large.shape[1]] = large

    def shade(
        self, cover: NDArray[np.float64], corners: tuple[Point, Point, Point], colour: Colour
    ) -> None:
        """Lay a colour over a parallelogram.

        Parameters
        ----------
        cover : (R, C) array
            Share of the colour in each cell, 0..1.
        corners : three points
            Places of the upper left, upper right and lower left corners of the array.
        colour : (int, int, int)
            Red, green, blue.

        """
        rows, columns = cover.shape
        # OpenCV's coordinates are pixel centres: half a pixel from the corners that are given.
        source = np.array([(-0.5, -0.5), (columns - 0.5, -0.5), (-0.5, rows - 0.5)], np.float32)
        target = np.array(corners, np.float32) * _SCALE - np.float32(0.5)
        fourth = target[1] + target[2] - target[0]
        around = np.vstack([target, fourth])
        height, width = self._pixels.shape[:2]
        x0, y0 = np.maximum(np.floor(around.min(0)).astype(int), 0)
        x1, y1 = np.minimum(np.ceil(around.max(0)).astype(int) + 1, (width, height))
        if x0 >= x1 or y0 >= y1:
            return
        alpha = cv2.warpAffine(
            cover.astype(np.float32),
            cv2.getAffineTransform(source, target - np.array((x0, y0), np.float32)),
            (int(x1 - x0), int(y1 - y0)),
            flags=cv2.INTER_NEAREST,
        )[..., None]
        part = self._pixels[y0:y1, x0:x1]
        part[:] = np.rint(part + alpha * (np.array(colour, np.float32) - part))

    def text(
        self,
        place: Point,
        text: str,
        size: float,
        colour: Colour = (0, 0, 0),
        *,
        anchor: Literal["left", "middle", "right"] = "middle",
    ) -> None:
        """Write one line of text, its height centred on `place`; ``θ_X`` is set as a symbol.

        Parameters
        ----------
        place : (x, y)
            The line's left end, middle or right end, as `anchor` says.
        text : str
            The text; ``θ_`` takes X, Y or Z.
        size : float
            Font size in pixels.
        colour : (int, int, int)
            Red, green, blue.
        anchor : str
            Which point of the line `place` is.

        """
        parts = [part for part in _THETA.split(text) if part]
        widths = [
            _THETA_WIDTH * size if _THETA.match(part) else float(_font(size).getlength(part))
            for part in parts
        ]
        x = place[0] - {"left": 0.0, "middle": 0.5, "right": 1.0}[anchor] * sum(widths)
        for part, width in zip(parts, widths, strict=True):
            if _THETA.match(part):
                self._theta(x, place[1], size, colour)
                below = place[1] + 0.28 * size
                self._texts.append((x + 0.46 * size, below, part[-1], 0.62 * size, colour))
            else:
                self._texts.append((x, place[1], part, size, colour))
            x += width

    def _theta(self, x: float, y: float, size: float, colour: Colour) -> None:
        """Draw a theta, which the built-in font does not have."""
        half = (0.19 * size, 0.37 * size)
        centre = (x + 0.05 * size + half[0], y)
        stroke = max(1, round(0.075 * size * _SCALE))
        axes = (round(half[0] * _SCALE * (1 << _BITS)), round(half[1] * _SCALE * (1 << _BITS)))
        cv2.ellipse(
            self._pixels, _fixed(centre), axes, 0, 0, 360, colour, stroke, cv2.LINE_AA, _BITS
        )
        self.line((centre[0] - half[0], y), (centre[0] + half[0], y), colour, stroke / _SCALE)


def _fixed(point: Point) -> tuple[int, int]:
    """Turn a place into OpenCV's fixed-point pixel centres."""
    x, y = ((float(value) * _SCALE - 0.5) * (1 << _BITS) for value in point)
    return round(x), round(y)


def _font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
