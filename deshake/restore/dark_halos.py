"""How to keep halos from falling to black.

Errors of an estimated kernel, and tone curves that no file tells of, leave dark halos beside bright
things. In linear light they are faint, but on display they are black. Blur takes the mean of what
the camera passed over, so the blurred photo is seldom much lighter than what lies there: a restored
pixel is taken to be at least a share of the darkest blurred one within the blur's reach,

    f >= 0.1 mean min g,

averaged over as much for a bound without edges of its own, which is still nowhere above g. Thin
dark lines on a bright ground are the exception that keeps the share low.
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

_SHARE = np.float32(0.1)


def without_dark_halos(
    f: NDArray[np.float32], g: NDArray[np.float32], kernel: RotationKernel
) -> NDArray[np.float32]:
    """Lift what was restored darker than the blurred photo makes likely.

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
    for channel in channels:  # one at a time, for the sake of memory
        floor = cv2.erode(np.ascontiguousarray(g[channel]), window)
        floor = cv2.blur(floor, (reach, reach))
        np.maximum(f[channel], _SHARE * floor, out=lifted[channel])
    return lifted
