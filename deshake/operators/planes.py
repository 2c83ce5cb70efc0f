"""Images as stacks of planes: channels first, windows beyond the border, checks of sizes."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["add_at", "channels_first", "check_size", "image_like", "mean_plane", "window_of"]

Image = NDArray[np.float32]


def channels_first(image: Image) -> Image:
    """View an image (h, w) or (h, w, C) as (C, h, w)."""
    return image[None] if image.ndim == 2 else np.moveaxis(image, -1, 0)


def image_like(channels: Image, image: Image) -> Image:
    """View (C, h, w) as an image with as many dimensions as another."""
    return channels[0] if image.ndim == 2 else np.moveaxis(channels, 0, -1)


def mean_plane(planes: Image) -> Image:
    """Average planes (C, h, w).

    NumPy's own mean takes ten times as long where the colours of a pixel lie side by side.
    """
    mean: Image = planes[0].astype(np.float32)
    for plane in planes[1:]:
        mean += plane
    mean /= np.float32(len(planes))
    return mean


def fitted(planes: Image, shape: tuple[int, int], *, beyond: float | None = None) -> Image:
    """Cut planes (..., h, w) to a height and width on all sides alike, or extend them.

    The new pixels are `beyond`, by default the nearest edge pixels. Raise ValueError unless one
    shape lies in the middle of the other.
    """
    margin = (shape[0] - planes.shape[-2]) // 2
    if planes.shape[-2:] != (shape[0] - 2 * margin, shape[1] - 2 * margin):
        raise ValueError(f"an image of {planes.shape[-2:]} pixels does not fit {shape}")
    if margin <= 0:
        return planes[..., -margin : shape[0] - margin, -margin : shape[1] - margin]
    around = [(0, 0)] * (planes.ndim - 2) + [(margin, margin)] * 2
    if beyond is None:
        return np.pad(planes, around, mode="edge")
    return np.pad(planes, around, constant_values=beyond)


def check_size(planes: NDArray[np.generic], shape: tuple[int, int]) -> None:
    """Raise ValueError unless planes (C, h, w) have the height and width given."""
    if planes.ndim != 3 or planes.shape[1:] != shape:
        msg = f"an image of {planes.shape[1:]} pixels does not fit {shape}"
        raise ValueError(msg)


def window_of(image: Image, top: int, left: int, height: int, width: int) -> Image:
    """Cut a window out of (C, H, W), zero where it reaches beyond the image."""
    y0, y1 = max(top, 0), min(top + height, image.shape[1])
    x0, x1 = max(left, 0), min(left + width, image.shape[2])
    if (y0, y1, x0, x1) == (top, top + height, left, left + width):
        return image[:, y0:y1, x0:x1]
    out = np.zeros((len(image), height, width), np.float32)
    if y1 > y0 and x1 > x0:
        out[:, y0 - top : y1 - top, x0 - left : x1 - left] = image[:, y0:y1, x0:x1]
    return out


def add_at(image: Image, top: int, left: int, piece: Image) -> None:
    """Add a piece to (C, H, W) at a place; discard the part beyond the image."""
    _, height, width = piece.shape
    y0, y1 = max(top, 0), min(top + height, image.shape[1])
    x0, x1 = max(left, 0), min(left + width, image.shape[2])
    if y1 > y0 and x1 > x0:
        inside = piece[:, y0 - top : y1 - top, x0 - left : x1 - left]
        for plane, part in zip(image, inside, strict=True):
            cv2.accumulate(part, plane[y0:y1, x0:x1])
