"""A lower bound that keeps halos from becoming black.

Errors of an estimated kernel, and unknown tone curves, leave dark halos beside bright objects. In
linear light they are faint, but on display they are black. A blurred pixel is a mean of the light
along the camera's path, so it is seldom much brighter than the scene there. The bound for a
restored pixel is a share of the darkest blurred one within the blur's reach,

    f >= 0.1 mean min g.

The mean over the same reach smooths the bound, which is still nowhere above g. The share is low
because of thin dark lines on a bright ground.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel

__all__ = ["without_dark_halos"]

_SHARE = np.float32(0.1)  # bound, as a share of the darkest blurred light within reach


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
    reach = ceil(kernel.extent_px()) | 1
    window = np.ones((reach, reach), np.uint8)
    lifted = np.empty_like(f)
    channels = [...] if f.ndim == 2 else [np.s_[..., c] for c in range(f.shape[2])]
    for channel in channels:  # one at a time, to save memory
        floor = cv2.erode(np.ascontiguousarray(g[channel]), window)
        floor = cv2.blur(floor, (reach, reach))
        np.maximum(f[channel], _SHARE * floor, out=lifted[channel])
    return lifted
