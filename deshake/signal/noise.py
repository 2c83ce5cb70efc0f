"""How noisy a picture is, by its second differences."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["noise_level"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_SECOND_DIFFERENCES = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
_MEDIAN = 0.6745  # of the absolute value of a standard normal variable
_STRIPS = 6
_MOST_PIXELS = 500_000


def noise_level(picture: Image, where: Mask | None = None) -> float:
    """Estimate the standard deviation of white noise (Immerkaer 1996, with the median).

    What is exactly flat, a black sky, says nothing of the noise and does not count.

    Parameters
    ----------
    picture : (h, w) array of float32
        The picture. Of a large one six strips are measured.
    where : (h, w) array of bool, optional
        Pixels that count; by default all.

    """
    if where is None and picture.size > _MOST_PIXELS:
        rows = max(_MOST_PIXELS // _STRIPS // picture.shape[1], 3)
        tops = np.linspace(0, picture.shape[0] - rows, _STRIPS).astype(int)
        rough = np.concatenate(
            [cv2.filter2D(picture[t : t + rows], -1, _SECOND_DIFFERENCES)[1:-1] for t in tops]
        )
    else:
        rough = cv2.filter2D(picture, -1, _SECOND_DIFFERENCES)
    sizes = np.abs(rough if where is None else rough[where])
    sizes = sizes[sizes > 0]
    return float(np.median(sizes)) / _MEDIAN if sizes.size else 0.0
