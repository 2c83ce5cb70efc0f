"""Sheets of pictures with captions, which show results side by side."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from deshake.formats.conversion import encoded
from deshake.formats.transfer import LINEAR, SRGB

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.formats.photo import Photo
    from deshake.pictures.canvas import Picture

__all__ = ["CHARACTER", "GAP", "Line", "detailed_part", "resized", "sheet", "shown"]

GAP = 8
"""Pixels between pictures, and around them."""

CHARACTER = 8.5
"""Width in pixels of a character of the captions, about."""

_FONT = 16
_LINE = 22  # from one line of text to the next
_DETAIL_STEPS = 24  # places across and down where the part with most detail is looked for
_BLACK, _RED = (0, 0, 0), (176, 0, 0)


class Line(NamedTuple):
    """A line of the sheet: pictures side by side, titles above them, and words above all."""

    caption: list[str]
    cells: list[Picture]
    failed: bool = False
    titles: Sequence[str] = ()


def shown(photo: Photo) -> Picture:
    """Return a photo's pixels as they are shown: (H, W, 3) uint8; linear light by sRGB's curve."""
    encoding = photo.encoding
    curve = SRGB if encoding.transfer == LINEAR else encoding.transfer
    codes = encoded(photo.pixels, replace(encoding, depth=8, transfer=curve))
    return np.asarray(np.dstack([codes] * 3) if codes.ndim == 2 else codes, np.uint8)


def resized(picture: Picture, width: int) -> Picture:
    """Resize a picture to a width."""
    height = max(round(picture.shape[0] * width / picture.shape[1]), 1)
    image = Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS)
    return np.asarray(image)


def detailed_part(picture: Picture, width: int, height: int) -> tuple[slice, slice]:
    """Find the part of this size, or less in a small picture, with the most detail.

    Detail is the mean of the Laplacian's magnitude after a little smoothing, so that noise does
    not count for texture.
    """
    h, w = min(height, picture.shape[0]), min(width, picture.shape[1])
    grey = cv2.GaussianBlur(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), (0, 0), 1.5)
    total = cv2.integral(np.abs(cv2.Laplacian(grey, cv2.CV_32F)))
    top = np.unique(np.linspace(0, picture.shape[0] - h, _DETAIL_STEPS).astype(int))
    left = np.unique(np.linspace(0, picture.shape[1] - w, _DETAIL_STEPS).astype(int))
    y, x = np.meshgrid(top, left, indexing="ij")
    detail = total[y + h, x + w] - total[y, x + w] - total[y + h, x] + total[y, x]
    best = np.unravel_index(np.argmax(detail), detail.shape)
    return slice(y[best], y[best] + h), slice(x[best], x[best] + w)


def sheet(lines: Sequence[Line], width: int = 0) -> Image.Image:
    """Draw the lines below each other, on a page of at least that width."""
    font = ImageFont.load_default(_FONT)
    heights = [
        _LINE * (len(line.caption) + bool(line.titles))
        + max((cell.shape[0] for cell in line.cells), default=0)
        + 3 * GAP
        for line in lines
    ]
    widths = [sum(cell.shape[1] + GAP for cell in line.cells) + GAP for line in lines]
    image = Image.new("RGB", (max([width, *widths]), sum(heights) + GAP), "white")
    draw = ImageDraw.Draw(image)
    top = GAP
    for line, height in zip(lines, heights, strict=True):
        for number, text in enumerate(line.caption):
            colour = _RED if line.failed else _BLACK
            draw.text((GAP, top + number * _LINE), text, colour, font)
        below = top + _LINE * (len(line.caption) + bool(line.titles)) + GAP
        left = GAP
        for number, cell in enumerate(line.cells):
            if line.titles:
                draw.text((left, below - _LINE), line.titles[number], _BLACK, font)
            image.paste(Image.fromarray(cell), (left, below))
            left += cell.shape[1] + GAP
        top += height
    return image
