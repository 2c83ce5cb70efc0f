"""Small copies of a blurred and a noisy photo, of one size and both upright."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError
from deshake.pair.registration_settings import SETTINGS

if TYPE_CHECKING:
    from deshake.geometry.camera import Camera

__all__ = ["SmallPair", "possible_turns", "reduce_pair"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SmallPair:
    """Two photos at one small size.

    Parameters
    ----------
    g, f : (h, w) arrays of float32
        The blurred photo, and the noisy one turned upright: means of their channels.
    usable : (h, w) array of bool
        Where both are below clipping.
    camera : Camera
        The camera at this size.

    """

    g: Image
    f: Image
    usable: Mask
    camera: Camera


def possible_turns(one: tuple[int, int], other: tuple[int, ...]) -> list[int]:
    """Return the numbers of quarter turns that may make another photo upright, for `numpy.rot90`.

    Raises
    ------
    EstimationError
        If it has other proportions.

    """
    aspect = one[1] / one[0]
    turns = []
    if abs(other[1] / other[0] / aspect - 1) < SETTINGS.proportions:
        turns.append(0)
    if abs(other[0] / other[1] / aspect - 1) < SETTINGS.proportions:
        turns += [1, 3]
    if not turns:
        raise EstimationError(
            f"the photos have different proportions: {one[1]} x {one[0]} and "
            f"{other[1]} x {other[0]} pixels",
            hint="both must be whole photos of one camera, not cropped",
        )
    return turns


def reduce_pair(g: Image, f_N: Image, camera: Camera, turns: int) -> SmallPair:
    """Reduce two photos to one small size, and turn the second one by quarters.

    Parameters
    ----------
    g, f_N : (h, w[, C]) and (h', w'[, C]) arrays of float32
        The photos, in linear light.
    camera : Camera
        The camera of the first.
    turns : int
        Number of quarter turns of the second one.

    Raises
    ------
    EstimationError
        If one is too small, or too long for its width.

    """
    longer, shorter = max(camera.shape), min(camera.shape)
    factor = min(max(SETTINGS.side / longer, SETTINGS.least_side / shorter), 1.0)
    shape = (round(camera.height * factor), round(camera.width * factor))
    if (
        min(shape) < SETTINGS.least_side
        or min(f_N.shape[:2]) < SETTINGS.least_side
        or max(shape) > SETTINGS.most_side
    ):
        raise EstimationError(
            f"a photo of {camera.width} x {camera.height} pixels is too small or too narrow",
            hint=f"register photos of at least {SETTINGS.least_side} pixels a side",
        )
    small_g, clipped_g = _reduced(g, shape)
    small_f, clipped_f = (
        np.rot90(image, turns) for image in _reduced(f_N, shape[::-1] if turns % 2 else shape)
    )
    usable = np.maximum(clipped_g, clipped_f) < SETTINGS.clipped_share
    return SmallPair(small_g, np.ascontiguousarray(small_f), usable, camera.scaled(*shape))


def _reduced(image: Image, shape: tuple[int, int]) -> tuple[Image, Image]:
    """Reduce a photo to the mean of its channels, and to the share of clipped pixels."""
    size = (shape[1], shape[0])
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    grey = small.reshape(*shape, -1).mean(-1, dtype=np.float32)
    clipped = image >= SETTINGS.clipped
    codes = np.uint8(255) * (clipped if image.ndim == 2 else clipped.any(-1)).astype(np.uint8)
    share = cv2.resize(np.asarray(codes), size, interpolation=cv2.INTER_AREA)
    return grey, np.asarray(share, np.float32) / np.float32(255)
