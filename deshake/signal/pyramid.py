"""A photo at every scale of a pyramid, from its own pixels to about 48 px on the shorter side.

Each scale is smaller than the one before by the square root of two. A pixel is the mean of linear
light over its area. All scales have the same contrast, because thresholds of gradients are
absolute.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError
from deshake.signal.noise import noise_level

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

    from deshake.geometry.camera import Camera

__all__ = ["RATIO", "Pyramid", "Scale", "reduced"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
T = TypeVar("T")

RATIO = 2**0.5
"""Size of one scale over that of the next coarser one."""

_COARSEST_SIDE = 48  # px: shorter side of the coarsest scale, about
_ROUNDING = 1e-9  # tolerance of logarithms
_CONTRAST = 0.1  # rms gradient of the scaled picture, reduced to `_CONTRAST_SIDE`
_CONTRAST_SIDE = 100  # px: longer side
_CONTRAST_FROM = 800  # px: longer side of the scale that the contrast is measured on
_LEAST_CONTRAST = 1e-4  # rms gradient on 0..1: less means that the photo is flat
_USABLE = 0.5  # share of usable pixels from which a reduced pixel is usable


class Scale(NamedTuple):
    """One scale of a photo.

    Parameters
    ----------
    stored : (h, w) array of float32
        Luminance in the tones of the scale, or in linear light if `is_light` is set.
    camera : Camera
        The camera of a photo of this size.
    usable : (h, w) array of bool, optional
        Pixels that are not clipped.
    contrast : float
        Factor that gives the picture the contrast of all pyramids.
    is_light : bool
        Whether `stored` is in linear light, and the tones of the scale are its root.

    """

    stored: Image
    camera: Camera
    usable: Mask | None
    contrast: float
    is_light: bool = False

    @property
    def picture(self) -> Image:
        """Luminance in linear light, or in its root, (h, w)."""
        return root(self.stored) if self.is_light else self.stored

    def piece(self, place: tuple[Any, ...]) -> Image:
        """Return the picture at an index of the array (h, w)."""
        piece: Image = self.stored[place]
        return root(piece) if self.is_light else piece


class Pyramid:
    """The scales of a photo, each made at its first use.

    Only the root of the light at full size is not kept. Tiles need pieces of it.

    Parameters
    ----------
    grey : (h, w) array of float32
        Luminance in linear light, 0..1.
    camera : Camera
        Its camera.
    usable : (h, w) array of bool, optional
        Pixels that are not clipped; by default all.
    is_displayed : bool, keyword-only
        Whether the scales are in the root of the light, which approximates display values.

    Raises
    ------
    EstimationError
        If the photo is flat.

    """

    def __init__(
        self,
        grey: Image,
        camera: Camera,
        usable: Mask | None = None,
        *,
        is_displayed: bool = False,
    ) -> None:
        self.camera = camera
        self.is_displayed = is_displayed
        self._grey = grey
        usable_all = usable is None or bool(usable.all())
        self._usable: dict[int, Mask | None] = {0: None if usable_all else usable}
        self._pictures: dict[int, Image] = {}
        self._cameras: dict[int, Camera] = {0: camera}
        self._kept: dict[Hashable, Any] = {}
        self._contrast = self._measured_contrast()

    @property
    def coarsest(self) -> int:
        """Index of the coarsest scale, whose shorter side has about 48 pixels."""
        shorter = min(self.camera.shape)
        return max(int(np.log(shorter / _COARSEST_SIDE) / np.log(RATIO) + _ROUNDING), 0)

    def at(self, level: int) -> Scale:
        """Return a scale; 0 is the photo itself, one more is smaller by the root of two."""
        is_light = self.is_displayed and level == 0
        stored = self._grey if is_light else self._picture(level)
        return Scale(stored, self.camera_at(level), self._mask(level), self._contrast, is_light)

    def camera_at(self, level: int) -> Camera:
        """Return the camera of a scale; its picture is not made."""
        if level not in self._cameras:
            self._cameras[level] = self.camera.scaled(*self._size(level))
        return self._cameras[level]

    def noise(self, level: int) -> float:
        """Return the standard deviation of a scale's noise, in the contrast of the pyramid."""
        return self.kept(
            ("noise", level), lambda: noise_level(self._picture(level)) * self._contrast
        )

    def kept(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return the value of a key; it is computed at the first request."""
        if key not in self._kept:
            self._kept[key] = make()
        value: T = self._kept[key]
        return value

    def zoomed(self, ratio: float) -> Pyramid:
        """Return the same pictures of a camera whose focal length is `ratio` times as long."""
        if ratio == 1:
            return self
        other = copy(self)
        cameras = {level: camera.zoomed(ratio) for level, camera in self._cameras.items()}
        vars(other).update(camera=cameras[0], _cameras=cameras, _kept={})
        return other

    def displayed(self) -> Pyramid:
        """Return the photo in the root of its light, which approximates display values."""
        other = Pyramid(self._grey, self.camera, is_displayed=True)
        other._usable = self._usable
        return other

    def forget(self) -> None:
        """Discard the pictures of all scales; each is made again at its next use."""
        self._pictures.clear()
        self._kept.clear()

    def level_of(self, pixels: float) -> int:
        """Return the index of the finest scale with at most so many pixels."""
        return max(int(np.ceil(np.log2(max(np.prod(self.camera.shape) / pixels, 1)))), 0)

    def _picture(self, level: int) -> Image:
        """Return the picture of a scale, in its own contrast."""
        if level == 0:
            return root(self._grey) if self.is_displayed else self._grey
        if level not in self._pictures:
            finer = self._picture(max(level - 2, 0))
            self._pictures[level] = reduced(finer, self._size(level))
        return self._pictures[level]

    def _mask(self, level: int) -> Mask | None:
        """Return the usable pixels of a scale."""
        if level not in self._usable:
            source = self._mask(max(level - 2, 0))
            self._usable[level] = (
                None
                if source is None
                else reduced(source.astype(np.float32), self._size(level)) > _USABLE
            )
        return self._usable[level]

    def _size(self, level: int) -> list[int]:
        """Return height and width of a scale."""
        return [max(round(n / RATIO**level), 1) for n in self.camera.shape]

    def _measured_contrast(self) -> float:
        shrink = max(max(self.camera.shape) / _CONTRAST_FROM, 1)
        return contrast_factor(self._picture(2 * int(np.log2(shrink))))


def root(light: Image) -> Image:
    """Return the root of linear light, which approximates display values."""
    clipped = np.clip(light, 0, 1)
    return np.sqrt(clipped, out=clipped)


def contrast_factor(picture: Image) -> float:
    """Return the factor that makes the rms gradient of a picture 0.1 when it is reduced to 100 px.

    Raises
    ------
    EstimationError
        If the picture is flat.

    """
    shrink = min(1.0, _CONTRAST_SIDE / max(picture.shape))
    small = reduced(picture, [max(round(n * shrink), 2) for n in picture.shape])
    across, down = np.diff(small, axis=1)[:-1], np.diff(small, axis=0)[:, :-1]
    contrast = float(np.sqrt((across**2 + down**2).mean()))
    if not contrast > _LEAST_CONTRAST:
        msg = "there is no detail to estimate the shake from"
        raise EstimationError(msg, hint="the photo is all of one colour, or nearly so")
    return _CONTRAST / contrast


def reduced(picture: Image, shape: Sequence[int]) -> Image:
    """Average a picture (h, w) or (h, w, C) to a smaller shape (rows, columns)."""
    if picture.shape[:2] == tuple(shape):
        return picture
    size = shape[1], shape[0]
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32, copy=False)
