"""Reducing a photo: each new pixel is a mean in linear light.

A mean has no negative weights. Filters that have some (bicubic, Lanczos) draw dark rims around
lamps, which show in linear light more than anywhere else.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np

from deshake.operators.strips import bands

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.formats.photo import Photo

__all__ = ["reduced", "reduced_with_metadata", "within_white"]

_BAND: Final = 256  # rows whose colours are converted at once


def reduced(photo: Photo, side: float) -> Photo:
    """Reduce the longer side of a photo to `side` pixels, if it is longer.

    A new pixel counts as clipped if one of its pixels is clipped. If the opacity varies, pixels
    count in proportion to it. Format, depth and metadata do not change.
    """
    height, width = photo.shape
    factor = max(photo.shape) / side
    if factor <= 1:
        return photo
    size = max(round(width / factor), 1), max(round(height / factor), 1)
    return replace(
        photo,
        pixels=_mean_light(photo, size),
        clipped=_means(photo.clipped.astype(np.float32), size) > 0,
        alpha=None if photo.alpha is None else _means(photo.alpha, size),
        frame=None,
    )


def reduced_with_metadata(photo: Photo, side: float) -> Photo:
    """Reduce a photo as `reduced` does; its metadata state what is true for the reduced photo."""
    small = reduced(photo, side)
    if small is photo:
        return photo
    return replace(small, metadata=photo.metadata.reduced(photo.shape, small.shape))


def within_white(photo: Photo) -> Photo:
    """Return a photo whose light is cut off at black and white, as in its file.

    The mean over a lamp and its dark surroundings is then the mean of the displayed picture. The
    colours of a RAW photo become those of its file.
    """
    encoding, pixels = photo.encoding, photo.pixels
    if encoding.matrix is None or pixels.ndim == 2:
        return photo.with_pixels(np.clip(pixels, 0, 1))
    matrix = np.array(encoding.matrix, np.float32).T
    light = np.empty_like(pixels)
    for band in bands(len(pixels), _BAND):
        np.clip(pixels[band] @ matrix, 0, 1, out=light[band])
    return replace(photo.with_pixels(light), encoding=replace(encoding, matrix=None))


def _mean_light(photo: Photo, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return means of the light, weighted by the opacity if it varies."""
    plain = _means(photo.pixels, size).astype(np.float32)
    alpha = photo.alpha
    if alpha is None or photo.encoding.premultiplied or alpha.min() == alpha.max():
        return plain
    weight = alpha.astype(np.float32)
    each = weight if photo.pixels.ndim == 2 else weight[..., None]
    light, whole = _means(photo.pixels * each, size), _means(weight, size)
    seen = whole > 0
    plain[seen] = light[seen] / (whole if plain.ndim == 2 else whole[..., None])[seen]
    return plain


def _means(values: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    return cv2.resize(values, size, interpolation=cv2.INTER_AREA)
