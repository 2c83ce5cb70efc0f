"""What the functions of the library take as a picture: an array in linear light, or a `Photo`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from deshake.errors import PhotoError
from deshake.formats.encoding import Encoding
from deshake.formats.photo import Photo
from deshake.metadata.metadata import Metadata

if TYPE_CHECKING:
    from typing import TypeAlias

__all__ = ["ARRAY", "NOISY_ARRAY", "Array", "Picture", "as_photo", "pixels_of"]

Array: TypeAlias = NDArray[np.floating[Any]]
Picture: TypeAlias = Photo | Array

ARRAY: Final = "the array"
NOISY_ARRAY: Final = "the noisy array"


def as_photo(picture: Picture, name: str = ARRAY) -> Photo:
    """Return a picture as a photo, after checking it.

    Parameters
    ----------
    picture : Photo or (H, W) or (H, W, 3) array of float
        A photo is returned unchanged. An array is linear light, and is clipped where a channel is 1
        or more; as a file it is sRGB of up to 16 bits a sample.
    name : str
        The name of an array in messages.

    Raises
    ------
    PhotoError
        If it is not an array of floating-point numbers of that shape, has no pixels, or is not
        finite.

    """
    if isinstance(picture, Photo):
        if not np.isfinite(picture.pixels).all():
            raise _not_finite(str(picture.source))
        return picture
    if isinstance(picture, (str, bytes, os.PathLike)):
        raise PhotoError(
            f"{os.fspath(picture)!r} is a name, not a picture", hint="read it by read_photo"
        )
    array = np.asarray(picture)
    if array.dtype.kind != "f":
        raise PhotoError(
            f"has the type {array.dtype}, and linear light is an array of floats",
            hint="read_photo gives linear light; codes of 8 bits must be decoded first",
            file=name,
        )
    if array.ndim not in {2, 3} or array.shape[2:] not in {(), (3,)}:
        raise PhotoError(
            f"has the shape {array.shape}, not (H, W) or (H, W, 3)",
            hint="an opacity channel is left out",
            file=name,
        )
    if array.size == 0:
        raise PhotoError(f"has no pixels: its shape is {array.shape}", file=name)
    with np.errstate(over="ignore"):
        pixels = np.ascontiguousarray(array, np.float32)
    if not np.isfinite(pixels).all():
        raise _not_finite(name)
    white = pixels >= 1
    return Photo(
        pixels=pixels,
        clipped=white if pixels.ndim == 2 else np.any(white, axis=-1),
        alpha=None,
        encoding=Encoding("PNG", depth=16, grey=pixels.ndim == 2),
        metadata=Metadata(),
        source=Path(name),
    )


def pixels_of(result: Photo, picture: Array) -> NDArray[np.float32]:
    """Return the pixels of a result as an array that shares no memory with the array given."""
    shared = np.may_share_memory(result.pixels, picture)
    return result.pixels.copy() if shared else result.pixels


def _not_finite(name: str) -> PhotoError:
    return PhotoError(
        "has pixels that are not finite numbers",
        hint="numpy.nan_to_num replaces them",
        file=name,
    )
