"""A lower bound that keeps halos from becoming black.

Errors of an estimated kernel, and unknown tone curves, leave dark halos beside bright objects. In
linear light they are faint, but on display they are black. A blurred pixel is a mean of the light
along the camera's path, so it is seldom much brighter than the scene there. The bound for a
restored pixel is a share of the darkest blurred one within the blur's reach,

    f >= mean (s min g).

The mean over the same reach smooths the bound, which is still nowhere above g. The share s is low,
because a thin dark line on a bright ground is darker than all that is left of it in the blurred
photo. Near a lamp it is high: where the brightest pixel around is many times as bright as the
darkest, the darkest one lies beyond the blur of the lamp, and shows the ground as it is.
"""

from __future__ import annotations

from math import ceil, log
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel

__all__ = ["without_dark_halos"]

_LEAST_SHARE: Final = 0.1  # bound, as a share of the darkest blurred light within reach
_MOST_SHARE: Final = 0.9
_CONTRASTS: Final = 8.0, 30.0  # between these ratios of brightest and darkest the share rises
_AROUND: Final = 2  # the brightest light is sought within so many times the reach
_DARKEST: Final = np.float32(1e-6)  # least light in the ratio


def without_dark_halos(
    f: NDArray[np.float32], g: NDArray[np.float32], kernel: RotationKernel
) -> NDArray[np.float32]:
    """Brighten pixels that the restoration made darker than the bound.

    Parameters
    ----------
    f : (h, w) or (h, w, C) array of float32
        The restored photo in linear light.
    g : array of the same shape
        The blurred photo.
    kernel : RotationKernel
        Its blur.

    Returns
    -------
    array of the same shape
        Nowhere darker than `f`.

    """
    width, height = (ceil(extent) | 1 for extent in kernel.extents_px())
    lifted = np.empty_like(f)
    channels = [...] if f.ndim == 2 else [np.s_[..., c] for c in range(f.shape[2])]
    for channel in channels:  # one at a time, to save memory
        floor = _floor(np.ascontiguousarray(g[channel]), (width, height))
        np.maximum(f[channel], floor, out=lifted[channel])
    return lifted


def _floor(g: NDArray[np.float32], reach: tuple[int, int]) -> NDArray[np.float32]:
    """Return the bound (h, w) for a channel, from the reach of the blur along x and y in pixels."""
    width, height = reach
    darkest = cv2.erode(g, np.ones((height, width), np.uint8))
    around = np.ones((_AROUND * height + 1, _AROUND * width + 1), np.uint8)
    brightest = cv2.dilate(g, around)
    contrast = np.clip(brightest / np.maximum(darkest, _DARKEST), *_CONTRASTS)
    rise = np.log(contrast / _CONTRASTS[0]) / log(_CONTRASTS[1] / _CONTRASTS[0])
    share = (_LEAST_SHARE + (_MOST_SHARE - _LEAST_SHARE) * rise) * darkest
    return np.asarray(cv2.blur(share, reach), np.float32)
