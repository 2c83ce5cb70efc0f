"""A photo at every scale of a pyramid, from its own pixels to about 48 px on the shorter side.

Each scale is smaller than the one before by the square root of two. A pixel is the mean of linear
light over its area. All scales have the same contrast, because thresholds of gradients are
absolute.
"""

from __future__ import annotations

import math
from copy import copy
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError
from deshake.operators.strips import bands
from deshake.signal.noise import noise_level

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

    from deshake.geometry.camera import Camera

__all__ = ["RATIO", "LightBefore", "Pyramid", "Scale", "ToneName", "Tones", "reduced"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
T = TypeVar("T")
Tones: TypeAlias = "Callable[[Image], Image]"
LightBefore: TypeAlias = "Callable[[Image, float], Image]"
ToneName = Literal["linear light", "display values", "light before a tone curve"]

RATIO = 2**0.5
"""Size of one scale over that of the next coarser one."""

_COARSEST_SIDE = 48  # px: shorter side of the coarsest scale, about
_ROUNDING = 1e-9  # tolerance of logarithms
_CONTRAST = 0.1  # rms gradient of the scaled picture, reduced to `_CONTRAST_SIDE`
_BAND = 16  # rows of a reduced picture that are made at a time
_LEAST_PART = 1e-3  # of a pixel that counts in a reduced one, as in OpenCV
_CONTRAST_SIDE = 100  # px: longer side
_CONTRAST_FROM = 800  # px: longer side of the scale that the contrast is measured on
_LEAST_CONTRAST = 1e-4  # rms gradient on 0..1: less means that the photo is flat
_CLIPPED = 0.5  # share of clipped pixels from which a reduced pixel is clipped


class Scale(NamedTuple):
    """One scale of a photo.

    Parameters
    ----------
    stored : (h, w) array of float32
        Luminance in the tones of the scale, or in linear light if `tones` is set.
    camera : Camera
        The camera of a photo of this size.
    clipped : (h, w) array of bool, optional
        Clipped pixels, if there are any.
    contrast : float
        Factor that gives the picture the contrast of all pyramids.
    tones : callable, optional
        If `stored` is in linear light, and the scale is not, it turns the one into the other.

    """

    stored: Image
    camera: Camera
    clipped: Mask | None
    contrast: float
    tones: Tones | None = None

    @property
    def picture(self) -> Image:
        """Luminance in the tones of the scale, (h, w)."""
        return self.stored if self.tones is None else self.tones(self.stored)

    def piece(self, place: tuple[Any, ...]) -> Image:
        """Return the picture at an index of the array (h, w)."""
        piece: Image = self.stored[place]
        return piece if self.tones is None else self.tones(piece)


class Pyramid:
    """The scales of a photo, each made at its first use.

    Only other tones than light are not kept at full size. Tiles need pieces of them.

    Parameters
    ----------
    grey : (h, w) array of float32
        Luminance in linear light, 0..1.
    camera : Camera
        Its camera.
    clipped : (h, w) array of bool, optional
        Clipped pixels; by default none. The array is kept, and not changed.
    tones : callable, optional, keyword-only
        Turns linear light into the tones of the scales; by default they are linear light.

    Raises
    ------
    EstimationError
        If the photo is flat.

    """

    def __init__(
        self,
        grey: Image,
        camera: Camera,
        clipped: Mask | None = None,
        *,
        tones: Tones | None = None,
    ) -> None:
        self.camera = camera
        self._grey = grey
        self._tones = tones
        self._of_light = None if self.is_displayed else tones
        none_clipped = clipped is None or not clipped.any()
        self._clipped: dict[int, Mask | None] = {0: None if none_clipped else clipped}
        self._pictures: dict[int, Image] = {}
        self._cameras: dict[int, Camera] = {0: camera}
        self._kept: dict[Hashable, Any] = {}
        self._contrast = self._measured_contrast()

    @property
    def is_displayed(self) -> bool:
        """Whether the scales are in the root of the light, which approximates display values."""
        return self._tones is root

    @property
    def tones(self) -> ToneName:
        """The name of the tones of the scales."""
        if self.is_displayed:
            return "display values"
        return "linear light" if self._tones is None else "light before a tone curve"

    @property
    def coarsest(self) -> int:
        """Index of the coarsest scale, whose shorter side has about 48 pixels."""
        shorter = min(self.camera.shape)
        return max(int(np.log(shorter / _COARSEST_SIDE) / np.log(RATIO) + _ROUNDING), 0)

    def at(self, level: int) -> Scale:
        """Return a scale; 0 is the photo itself, one more is smaller by the root of two."""
        tones = self._tones if level == 0 else None
        stored = self._grey if level == 0 else self._picture(level)
        return Scale(stored, self.camera_at(level), self._mask(level), self._contrast, tones)

    def camera_at(self, level: int) -> Camera:
        """Return the camera of a scale; its picture is not made."""
        if level not in self._cameras:
            self._cameras[level] = self.camera.scaled(*self._size(level))
        return self._cameras[level]

    def noise(self, level: int) -> float:
        """Return the standard deviation of a scale's noise, in the contrast of the pyramid."""
        return self.kept(("noise", level), lambda: self._measured_noise(level) * self._contrast)

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
        return self.in_tones(root)

    def in_other_tones(self) -> Pyramid:
        """Return the photo in the root of its light, or if this is the root, as it was before."""
        return self.in_tones(self._of_light) if self.is_displayed else self.displayed()

    def in_tones(self, tones: Tones | None) -> Pyramid:
        """Return the photo in tones that a callable makes of its light, or in light if None."""
        if tones is self._tones:
            return self
        other = Pyramid(self._grey, self.camera, tones=tones)
        other._clipped = self._clipped
        if other.is_displayed:
            other._of_light = self._of_light
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
        tones = self._tones
        if level == 0:
            return self._grey if tones is None else tones(self._grey)
        if level not in self._pictures:
            if tones is not None and level <= 2:
                self._pictures[level] = reduced_in_bands(self._grey, self._size(level), tones)
            else:
                finer = self._picture(max(level - 2, 0))
                self._pictures[level] = reduced(finer, self._size(level))
        return self._pictures[level]

    def _mask(self, level: int) -> Mask | None:
        """Return the clipped pixels of a scale."""
        if level not in self._clipped:
            source = self._mask(max(level - 2, 0))
            self._clipped[level] = (
                None
                if source is None
                else reduced_in_bands(source, self._size(level), as_numbers) >= _CLIPPED
            )
        return self._clipped[level]

    def _size(self, level: int) -> list[int]:
        """Return height and width of a scale."""
        return [max(round(n / RATIO**level), 1) for n in self.camera.shape]

    def _measured_noise(self, level: int) -> float:
        """Return the standard deviation of a scale's noise, in its own contrast."""
        if level == 0 and self._tones is not None:
            return noise_level(self._grey, tones=self._tones)
        return noise_level(self._picture(level))

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


def as_numbers(mask: Mask) -> Image:
    """Return 1 where a mask is set, and 0 elsewhere."""
    return mask.astype(np.float32)


def reduced_in_bands(
    pixels: NDArray[Any], shape: Sequence[int], values: Callable[[NDArray[Any]], Image]
) -> Image:
    """Average the values of pixels (h, w) to a smaller shape.

    A large photo has only the values of a band of rows in memory at a time.
    """
    height, ratio = len(pixels), len(pixels) / shape[0]
    result = np.empty(shape, np.float32)
    for band in bands(shape[0], _BAND):
        edges = np.arange(band.start, band.stop + 1) * ratio
        rows = np.arange(int(edges[0]), min(math.ceil(edges[-1]), height))
        parts = np.minimum(edges[1:, None], rows + 1) - np.maximum(edges[:-1, None], rows)
        shares = np.where(parts > _LEAST_PART, parts / ratio, 0).astype(np.float32)
        narrow = reduced(values(pixels[rows[0] : rows[-1] + 1]), [len(rows), shape[1]])
        result[band] = shares @ narrow
    return result


def reduced(picture: Image, shape: Sequence[int]) -> Image:
    """Average a picture (h, w) or (h, w, C) to a smaller shape (rows, columns)."""
    if picture.shape[:2] == tuple(shape):
        return picture
    size = shape[1], shape[0]
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32, copy=False)
