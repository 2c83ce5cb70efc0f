"""The mix of a result and its photo, by a strength and a mask.

The two are mixed in linear light, like two exposures of one scene. If the share of the result is
zero at a pixel, the pixel keeps the photo's value exactly.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from deshake.errors import PhotoError
from deshake.formats.encoding import SUFFIXES
from deshake.formats.photo import read_photo
from deshake.operators.strips import bands
from deshake.stages.fitting import same_proportions

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.formats.photo import Photo

__all__ = [
    "MASK",
    "Mask",
    "blended",
    "find_mask",
    "fit_mask",
    "mask_bytes",
    "mask_name",
    "read_mask",
]

Image = NDArray[np.float32]

MASK: Final = ".mask"
"""The part of a written mask's name before the ending."""

_GREY = 0.05  # share of full scale: largest difference of channels in a grey picture (JPEG)
_ROWS = 256  # rows in one step of the mix


@dataclass(frozen=True, eq=False)
class Mask:
    """Share of a photo that is kept, pixel by pixel.

    Parameters
    ----------
    share : (H, W) array of float32
        Share of the photo that is kept, 0..1, for each of its pixels.
    sha256 : str, optional
        SHA-256 of the bytes that were read from the mask's file.

    """

    share: Image
    sha256: str | None = None


def read_mask(file: Path, photo: Photo) -> Mask:
    """Read a mask: a grey picture of a photo's size, or of that size scaled.

    Parameters
    ----------
    file : Path
        The picture. White keeps the photo, black takes the result, and grey mixes the two. The
        values in the file are the shares, without a tone curve.
    photo : Photo
        The photo that the mask is for.

    Returns
    -------
    Mask
        The mask, of the photo's size.

    Raises
    ------
    PhotoError
        If the picture cannot be read, is not grey or not opaque, or has other proportions.

    """
    mask = read_photo(file, transfer="linear")
    if mask.alpha is not None and mask.alpha.min() < np.iinfo(mask.alpha.dtype).max:
        raise PhotoError(
            "the mask has transparent parts",
            hint="fill them with black or white, and save it without transparency",
            file=file,
        )
    pixels = mask.pixels
    if pixels.ndim == 3:
        if np.ptp(pixels, axis=-1).max() > _GREY:
            raise PhotoError(
                "a mask is grey, and this picture has colours",
                hint="white keeps the photo as it is, black takes the result",
                file=file,
            )
        pixels = pixels[..., 1]
    if not same_proportions(mask.shape, photo.shape):
        turned = same_proportions(mask.shape[::-1], photo.shape)
        raise PhotoError(
            f"the mask has {mask.described_size}, and {photo.source} has {photo.described_size}",
            hint="turn the mask: it belongs to the photo as it is seen, upright"
            if turned
            else "a mask has the size of its photo, or that size scaled",
            file=file,
        )
    return Mask(fit_mask(pixels, photo.shape), mask.sha256)


def fit_mask(mask: Image, shape: tuple[int, int]) -> Image:
    """Scale a mask (h, w) to a shape (H, W)."""
    if mask.shape == shape:
        return mask
    smaller = mask.shape[0] > shape[0]
    way = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    scaled: Image = cv2.resize(mask, shape[::-1], interpolation=way).astype(np.float32)
    return np.clip(scaled, 0, 1, out=scaled)


def find_mask(folder: Path, source: Path) -> Path | None:
    """Find the mask of a photo in a folder; None: there is none.

    It is the picture with the photo's stem, or with this stem and ``.mask``.

    Raises
    ------
    PhotoError
        If there are several such pictures.

    """
    candidates = sorted(
        path
        for path in folder.glob("*")
        if path.stem in {source.stem, f"{source.stem}{MASK}"}
        and path.suffix.lower() in SUFFIXES
        and path.is_file()
    )
    if len(candidates) > 1:
        names = " and ".join(path.name for path in candidates)
        raise PhotoError(f"{names} could both be its mask", hint="keep one of them", file=source)
    return candidates[0] if candidates else None


def mask_name(source: Path) -> str:
    """Return the name of the mask that is written for a photo: ``<stem>.mask.png``."""
    return f"{source.stem}{MASK}.png"


def mask_bytes(share: Image) -> bytes:
    """Return a mask as a PNG of 8 bits, as `read_mask` takes it; `share` is (H, W), 0..1."""
    grey = np.rint(np.clip(share, 0, 1) * 255).astype(np.uint8)
    stream = io.BytesIO()
    Picture.fromarray(grey).save(stream, "PNG")
    return stream.getvalue()


def blended(
    photo: Photo, result: Photo, *, strength: float = 1.0, mask: Image | None = None
) -> Photo:
    """Mix a result with its photo, in linear light.

    Parameters
    ----------
    photo, result : Photo
        The photo before and after the deblurring.
    strength : float
        Share of the result in the mix, 0..1.
    mask : (H, W) array, optional
        Share of the photo that is kept, 0..1, for each pixel. White keeps all of it, whatever the
        strength.

    Returns
    -------
    Photo
        The mix. A pixel with the full share of the result has exactly the result's value. Values
        of the result beyond black and white are clipped before the mix.

    """
    if strength == 0 or (mask is not None and mask.min() == 1):
        return photo
    if result is photo or (strength == 1 and mask is None):
        return result
    pixels = np.empty_like(photo.pixels)
    for rows in bands(photo.shape[0], _ROWS):
        before, after = photo.pixels[rows], result.pixels[rows]
        share = np.full(before.shape[:2], strength, np.float32)
        if mask is not None:
            share *= 1 - mask[rows]
        if before.ndim == 3:
            share = share[..., None]
        mixed = before + share * (np.clip(after, 0, 1) - before)
        pixels[rows] = np.where(share == 1, after, mixed)
    return result.with_pixels(pixels)
