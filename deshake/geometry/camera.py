"""The pinhole camera: focal length and principal point in pixels (Sec. 2.2).

Pixel centres lie at integer coordinates, so a frame of W by H pixels covers
``[-0.5, W - 0.5] x [-0.5, H - 0.5]`` and its middle is ``((W - 1) / 2, (H - 1) / 2)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["UNIFORM_FOCAL_FACTOR", "Camera"]

UNIFORM_FOCAL_FACTOR = 1000.0
"""Focal length of the uniform model, in longer sides of the frame.

Through so long a lens a rotation about X or Y is a translation of the whole frame, to within
one part in a million of its length: uniform blur is this special case of the rotational model.
"""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera and the size of its pictures.

    Parameters
    ----------
    matrix : (3, 3) array of float64
        K, in pixels: ``[[f, 0, x0], [0, f, y0], [0, 0, 1]]``.
    height, width : int
        Size of the pictures in pixels.

    Raises
    ------
    ValueError
        If the matrix is not a finite, invertible camera matrix or the size is not positive.

    """

    matrix: NDArray[np.float64]
    height: int
    width: int

    def __post_init__(self) -> None:
        """Check the fields and make them read-only."""
        matrix = np.array(self.matrix, np.float64)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
            msg = "a camera matrix has 3 x 3 finite entries"
            raise ValueError(msg)
        if matrix[0, 0] <= 0 or matrix[1, 1] <= 0 or np.any(matrix[2] != (0, 0, 1)):
            msg = "a camera matrix has positive focal lengths and 0, 0, 1 as its last row"
            raise ValueError(msg)
        if self.height < 1 or self.width < 1:
            msg = "a picture has at least one pixel"
            raise ValueError(msg)
        matrix.setflags(write=False)
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "height", int(self.height))
        object.__setattr__(self, "width", int(self.width))

    @classmethod
    def from_focal(cls, focal_px: float, height: int, width: int) -> Camera:
        """Make a camera with square pixels and its principal point in the middle (Sec. 2.2)."""
        x0, y0 = (width - 1) / 2, (height - 1) / 2
        matrix = np.array([[focal_px, 0, x0], [0, focal_px, y0], [0, 0, 1]], np.float64)
        return cls(matrix, height, width)

    @classmethod
    def uniform(cls, height: int, width: int) -> Camera:
        """Make the camera of the uniform model: a lens so long that rotations translate."""
        return cls.from_focal(UNIFORM_FOCAL_FACTOR * max(height, width), height, width)

    @property
    def focal_px(self) -> float:
        """Focal length in pixels (the geometric mean of the two axes)."""
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1]))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the pictures in pixels."""
        return self.height, self.width

    @property
    def is_uniform(self) -> bool:
        """Whether this is the camera of the uniform model, whose rotations are translations."""
        return self.focal_px >= 0.5 * UNIFORM_FOCAL_FACTOR * max(self.shape)

    @property
    def corners(self) -> NDArray[np.float64]:
        """The nine points (x, y) of the frame's corners, edge middles and middle, (9, 2)."""
        x = (0.0, (self.width - 1) / 2, self.width - 1.0)
        y = (0.0, (self.height - 1) / 2, self.height - 1.0)
        return np.array([(a, b) for b in y for a in x])

    def scaled(self, height: int, width: int) -> Camera:
        """Return the camera of the same photo resized to height x width pixels."""
        sx, sy = width / self.width, height / self.height
        resize = np.array([[sx, 0, sx / 2 - 0.5], [0, sy, sy / 2 - 0.5], [0, 0, 1]])
        return Camera(resize @ self.matrix, height, width)

    def cropped(self, x: int, y: int, width: int, height: int) -> Camera:
        """Return the camera of the crop whose upper left pixel is (x, y)."""
        shift = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1]], np.float64)
        return Camera(shift @ self.matrix, height, width)

    def padded(self, margin: int) -> Camera:
        """Return the camera of the picture with `margin` pixels added on every side."""
        return self.cropped(-margin, -margin, self.width + 2 * margin, self.height + 2 * margin)
