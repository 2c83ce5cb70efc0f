"""The luminance of a picture in linear light."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["luminance"]

_LUMINANCE: Final = (0.2126, 0.7152, 0.0722)  # of linear sRGB, ITU-R BT.709


def luminance(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the luminance (H, W) of linear pixels (H, W) or (H, W, 3), by sRGB's primaries."""
    if pixels.ndim == 2:
        return pixels
    grey = pixels[..., 0] * np.float32(_LUMINANCE[0])
    for channel in (1, 2):
        grey += pixels[..., channel] * np.float32(_LUMINANCE[channel])
    return grey
