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

__all__ = ["CHARACTER", "GAP", "Row", "detailed_part", "resized", "sheet", "shown"]

GAP = 8
"""Pixels between pictures, and around them."""

CHARACTER = 8.5
"""Approximate width of a character of the captions, in pixels."""

_FONT = 16  # px
_LINE = 22  # px from one line of text to the next
_DETAIL_STEPS = 24  # places across and down at which the detail is measured
_BLACK, _RED = (0, 0, 0), (176, 0, 0)


class Row(NamedTuple):
    """A row of the sheet: pictures side by side, a title above each, and a caption above all."""

    caption: list[str]
    cells: list[Picture]
    failed: bool = False
    titles: Sequence[str] = ()


def shown(photo: Photo) -> Picture:
    """Return a photo's pixels for display, (H, W, 3) uint8; linear light gets sRGB's curve."""
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
    """Find the part of this size with the most detail; in a small picture the part is smaller.

    Detail is the mean of the Laplacian's magnitude after a little smoothing, so that noise does
    not count as texture.
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


def sheet(rows: Sequence[Row], width: int = 0) -> Image.Image:
    """Draw the rows below each other, on a page of at least that width."""
    font = ImageFont.load_default(_FONT)
    heights = [
        _LINE * (len(row.caption) + bool(row.titles))
        + max((cell.shape[0] for cell in row.cells), default=0)
        + 3 * GAP
        for row in rows
    ]
    widths = [sum(cell.shape[1] + GAP for cell in row.cells) + GAP for row in rows]
    image = Image.new("RGB", (max([width, *widths]), sum(heights) + GAP), "white")
    draw = ImageDraw.Draw(image)
    top = GAP
    for row, height in zip(rows, heights, strict=True):
        for number, text in enumerate(row.caption):
            colour = _RED if row.failed else _BLACK
            draw.text((GAP, top + number * _LINE), text, colour, font)
        below = top + _LINE * (len(row.caption) + bool(row.titles)) + GAP
        left = GAP
        for number, cell in enumerate(row.cells):
            if row.titles:
                draw.text((left, below - _LINE), row.titles[number], _BLACK, font)
            image.paste(Image.fromarray(cell), (left, below))
            left += cell.shape[1] + GAP
        top += height
    return image
