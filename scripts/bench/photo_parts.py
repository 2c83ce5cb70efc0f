"""Parts of a large photo that are deblurred in place of the whole: where there is most to see."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from deshake.formats.photo import Photo

__all__ = ["Box", "part_of", "parts"]

Codes = NDArray[np.uint8]

WHOLE = 1.2e6  # pixels up to which a photo is deblurred whole
PART = (800, 560)  # px
OUTER = 2 / 3  # of the way from the middle, from which on a part is near a corner


class Box(NamedTuple):
    """A part of a photo, in pixels."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """The part's rows and columns."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def around(self, margin: int, shape: tuple[int, int]) -> Box:
        """The part with a margin, as far as the photo goes."""
        left, top = max(self.x - margin, 0), max(self.y - margin, 0)
        right = min(self.x + self.width + margin, shape[1])
        bottom = min(self.y + self.height + margin, shape[0])
        return Box(left, top, right - left, bottom - top)

    def within(self, other: Box) -> Box:
        """The same part in a crop of the photo."""
        return self._replace(x=self.x - other.x, y=self.y - other.y)


def detail_of(sharp: Codes, size: tuple[int, int], blur: float) -> NDArray[np.float64]:
    """Sum up the edges of each part, by its upper left pixel.

    Edges finer than a sixteenth of the blur do not count: nothing restores them.
    """
    grey = cv2.cvtColor(sharp, cv2.COLOR_BGR2GRAY).astype(np.float32)
    grey = cv2.GaussianBlur(grey, (0, 0), 1 + blur / 16)
    edges = np.hypot(*(cv2.Sobel(grey, cv2.CV_32F, dx, 1 - dx) for dx in (0, 1)))
    total = cv2.integral(edges, sdepth=cv2.CV_64F)
    across, down = size
    rows = total[down:] - total[:-down]
    return np.asarray(rows[:, across:] - rows[:, :-across])


def apartness(shape: tuple[int, int], box: Box) -> NDArray[np.float64]:
    """Return the share of each part, by its upper left pixel, that lies outside a box."""
    y, x = (np.arange(side) for side in shape)
    rows = np.clip(1 - np.abs(y - box.y) / box.height, 0, 1)
    columns = np.clip(1 - np.abs(x - box.x) / box.width, 0, 1)
    return 1 - np.outer(rows, columns)


def parts(sharp: Codes, blur: float) -> list[Box]:
    """Choose the parts of a photo to deblur: all, or two parts that hardly overlap."""
    height, width = sharp.shape[:2]
    if height * width <= WHOLE:
        return [Box(0, 0, width, height)]
    size = min(PART[0], width), min(PART[1], height)
    detail = detail_of(sharp, size, blur)
    top, left = divmod(int(detail.argmax()), detail.shape[1])
    first = Box(left, top, *size)
    y, x = (np.abs(np.linspace(-1, 1, side)) >= OUTER for side in detail.shape)
    detail *= (y[:, None] & x) * apartness(detail.shape, first) ** 3
    top, left = divmod(int(detail.argmax()), detail.shape[1])
    return [first, Box(left, top, *size)]


def part_of(photo: Photo, box: Box) -> Photo:
    """Crop a photo."""
    return replace(
        photo,
        pixels=np.ascontiguousarray(photo.pixels[box.slices]),
        clipped=np.ascontiguousarray(photo.clipped[box.slices]),
        alpha=None,
        frame=None,
    )
