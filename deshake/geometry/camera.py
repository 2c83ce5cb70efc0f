"""The camera: focal length and principal point in pixels (Sec. 2.2), and its lens's distortion.

Pixel centres lie at integer coordinates, so a frame of W by H pixels covers
``[-0.5, W - 0.5] x [-0.5, H - 0.5]`` and its middle is ``((W - 1) / 2, (H - 1) / 2)``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["UNIFORM_FOCAL_FACTOR", "Camera"]

UNIFORM_FOCAL_FACTOR = 1000.0
"""Focal length of the uniform model, in longer sides of the frame.

Through so long a lens, a rotation about X or Y translates the whole frame, to within one part in a
million of its length. So uniform blur is a special case of the rotational model.
"""

DISTORTION_LENGTHS: Final = (0, 4, 5, 8, 12)
"""Numbers of coefficients of OpenCV's models, without the models that tilt the sensor."""

# Coefficients scale with a power of the focal length. k1, k2, p1, p2, k3 to k6 and s1 to s4 belong
# to these powers of the distance from the axis, less one.
_POWERS: Final = np.array([2, 4, 1, 1, 6, 2, 4, 6, 1, 3, 1, 3])


def _no_distortion() -> NDArray[np.float64]:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera and the size of its pictures.

    Parameters
    ----------
    matrix : (3, 3) array of float64
        K, in pixels: ``[[f, 0, x0], [0, f, y0], [0, 0, 1]]``.
    height, width : int
        Size of the pictures in pixels.
    distortion : (k,) array of float64
        Lens distortion in OpenCV's order (k1, k2, p1, p2, k3, ...); empty: a pinhole. Blur and
        restoration treat every camera as a pinhole: `geometry.distortion` comes first.

    Raises
    ------
    ValueError
        If the matrix is not a finite, invertible camera matrix, the size is not positive, or the
        distortion not 0, 4, 5, 8 or 12 finite numbers.

    Examples
    --------
    >>> from deshake import Camera
    >>> camera = Camera.from_focal(900.0, height=480, width=720)
    >>> camera.focal_px, camera.shape
    (900.0, (480, 720))
    >>> camera.scaled(240, 360).focal_px  # of the same photo at half the size
    450.0

    """

    matrix: NDArray[np.float64]
    height: int
    width: int
    distortion: NDArray[np.float64] = field(default_factory=_no_distortion)

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
        distortion = np.array(self.distortion, np.float64)
        if distortion.shape not in [(n,) for n in DISTORTION_LENGTHS] or not (
            np.isfinite(distortion).all()
        ):
            msg = "'distortion' is not 0, 4, 5, 8 or 12 finite numbers"
            raise ValueError(msg)
        matrix.setflags(write=False)
        distortion.setflags(write=False)
        object.__setattr__(self, "distortion", distortion)
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "height", int(self.height))
        object.__setattr__(self, "width", int(self.width))

    @classmethod
    def from_focal(cls, focal_px: float, height: int, width: int) -> Camera:
        """Make a pinhole with square pixels and its principal point in the middle (Sec. 2.2)."""
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
    def is_pinhole(self) -> bool:
        """Whether there is no distortion."""
        return not self.distortion.any()

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
        return replace(self, matrix=resize @ self.matrix, height=height, width=width)

    def cropped(self, x: int, y: int, width: int, height: int) -> Camera:
        """Return the camera of the crop whose upper left pixel is (x, y)."""
        shift = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1]], np.float64)
        return replace(self, matrix=shift @ self.matrix, height=height, width=width)

    def zoomed(self, ratio: float) -> Camera:
        """Return the camera of the same photo, with a focal length `ratio` times as long."""
        if ratio == 1:
            return self
        longer = self.matrix * np.array([[ratio, ratio, 1], [ratio, ratio, 1], [1, 1, 1]])
        return replace(self, matrix=longer)

    def padded(self, margin: int) -> Camera:
        """Return the camera of the picture with `margin` pixels added on every side."""
        return self.cropped(-margin, -margin, self.width + 2 * margin, self.height + 2 * margin)

    def with_lens(self, distortion: NDArray[np.float64]) -> Camera:
        """Return the camera with a lens's distortion."""
        return replace(self, distortion=distortion)

    def as_uniform(self) -> Camera:
        """Return the camera of the uniform model for the same photo, with the same distortion."""
        whole = Camera.uniform(self.height, self.width)
        powers = _POWERS[: len(self.distortion)]
        distortion = self.distortion * (whole.focal_px / self.focal_px) ** powers
        x0, y0 = self.matrix[:2, 2]
        matrix = np.array([[whole.focal_px, 0, x0], [0, whole.focal_px, y0], [0, 0, 1]])
        return whole if self.is_pinhole else replace(self, matrix=matrix, distortion=distortion)
