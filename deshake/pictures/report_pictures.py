"""The pictures of one photo on the page of a report: small enough for a page of hundreds.

The process that works on the photo makes them, and hands them to the page as bytes.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import cv2
import numpy as np
from PIL import Image

from deshake.pictures.render import render_filters
from deshake.pictures.sheets import detailed_part, shown

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from deshake.formats.photo import Photo
    from deshake.geometry.kernel import RotationKernel
    from deshake.pictures.canvas import Picture

__all__ = ["Encoded", "ReportPictures", "report_pictures", "room_for"]

Rectangle: TypeAlias = tuple[int, int, int, int]
"""Left, top, width and height in pixels."""

_PAGE_BYTES: Final = 40_000_000  # of all pictures of a page; base64 makes 53 million of them
_MOST_BYTES: Final = 3_000_000  # of one photo's pictures, at most
_BESIDE_BYTES: Final = 8_000_000  # the same, if they are files beside the page
_FEWEST_BYTES: Final = 20_000  # of one photo's pictures: thousands of photos make a larger page

_FRAME_SIDE: Final = 1600  # px of the longer side of the whole frame, at most
_DETAIL: Final = (360, 270)  # px, width and height of the part that is shown first
_FRAME_SHARE: Final = 0.45  # of the room, for the whole frame; the rest is for the part at 100 %
_PIXEL_BYTES: Final = 0.1  # bytes per pixel, for the size of the first part that is tried
_QUALITIES: Final = (88, 80, 72)  # of JPEG, tried before the picture is made smaller
_LAST_QUALITIES: Final = (50, 30, 15)  # of JPEG, if the picture cannot be made smaller
_SHRINK: Final = 0.85  # factor of the sides from one try to the next
_LEAST_SIDE: Final = 48  # px: no picture is made smaller than this
_FILTERS: Final = 3  # number of local filters down and across the frame
_KERNEL_SIDE: Final = 600  # px
_MOVING_SHARE: Final = 0.1  # of the room, for the picture of what moved
_MOVING_SIDE: Final = 600  # px of its longer side, at most
_TINT: Final = (255, 120, 0)
_TINTED: Final = np.float32(0.7)  # share of the colour where the whole photo is kept
_FAINT: Final = 0.01  # of the largest weight: lighter rotations are not drawn
_KERNEL_COLOURS: Final = 16  # greys of the picture of a kernel


class Encoded(NamedTuple):
    """A picture as the bytes of a JPEG or PNG file."""

    data: bytes
    width: int
    height: int
    ending: str = "jpg"


@dataclass(frozen=True)
class ReportPictures:
    """The pictures of one photo.

    Parameters
    ----------
    shape : (int, int)
        Height and width of the result in pixels.
    before, after : Encoded
        The whole frame; there is no `after` if the photo is unchanged.
    part, part_after : Encoded
        A part at 100 %.
    at : (int, int)
        Left and top of the part in the photo, in pixels.
    detail : Rectangle
        Left, top, width and height of the most detailed place, in pixels of the part.
    kernel : Encoded, optional
        The paths that points of light draw in nine places of the frame.
    moving : Encoded, optional
        The frame with the parts tinted that keep the photo because they moved.

    """

    shape: tuple[int, int]
    before: Encoded
    after: Encoded | None
    part: Encoded
    part_after: Encoded | None
    at: tuple[int, int]
    detail: Rectangle
    kernel: Encoded | None
    moving: Encoded | None = None


def room_for(photos: int, *, beside: bool = False) -> int:
    """Return how many bytes the pictures of one photo may take.

    The photos of a page share its bytes. Pictures `beside` the page are files of their own.
    """
    if beside:
        return _BESIDE_BYTES
    return max(_FEWEST_BYTES, min(_MOST_BYTES, _PAGE_BYTES // max(photos, 1)))


def report_pictures(
    photo: Photo,
    result: Photo,
    kernel: RotationKernel,
    room: int,
    *,
    moving: NDArray[np.float32] | None = None,
) -> ReportPictures:
    """Make the pictures of a photo and its result.

    Parameters
    ----------
    photo, result : Photo
        Before and after, of one size.
    kernel : RotationKernel
        The kernel of the deblurring. If it is that of a still camera, there is no `after`.
    room : int
        Bytes that all pictures together may take, `_FEWEST_BYTES` at least.
    moving : (H, W) array of float32, optional
        Share of the photo that the result keeps where something moved.

    """
    still = kernel.is_still
    drawn = None if still else _drawn(kernel)
    photos = [photo] if still else [photo, result]
    left = room - (0 if drawn is None else len(drawn.data))
    frames = [_reduced(each, _FRAME_SIDE) for each in photos]
    tinted = None if still or moving is None else _tinted(frames[0], moving, _MOVING_SHARE * left)
    left -= 0 if tinted is None else len(tinted.data)
    place = _detail(frames[0], photo.shape)

    def frame(share: float) -> list[Picture]:
        return [_resized(each, share) for each in frames]

    def part(share: float) -> list[Picture]:
        return [_crop(each, _around(place, photo.shape, share)) for each in photos]

    whole, _ = _fitted(frame, _FRAME_SHARE * left, 1.0)
    pixels = len(photos) * photo.shape[0] * photo.shape[1]
    enough = math.sqrt((1 - _FRAME_SHARE) * left / (_PIXEL_BYTES * pixels))
    parts, share = _fitted(part, (1 - _FRAME_SHARE) * left, min(1.0, enough))
    x, y, *_ = _around(place, photo.shape, share)
    return ReportPictures(
        photo.shape,
        whole[0],
        None if still else whole[1],
        parts[0],
        None if still else parts[1],
        (x, y),
        (place[0] - x, place[1] - y, *place[2:]),
        drawn,
        tinted,
    )


def _tinted(frame: Picture, moving: NDArray[np.float32], limit: float) -> Encoded:
    """Draw the frame in grey, with a colour where the photo is kept, in at most `limit` bytes."""
    grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)[..., None].astype(np.float32)
    share = cv2.resize(moving, frame.shape[1::-1], interpolation=cv2.INTER_AREA)[..., None]
    mixed = grey + _TINTED * share * (np.array(_TINT, np.float32) - grey)
    picture = np.rint(mixed).astype(np.uint8)
    size = min(1.0, _MOVING_SIDE / max(picture.shape))
    return _fitted(lambda factor: [_resized(picture, factor)], limit, size)[0][0]


def _around(place: Rectangle, shape: tuple[int, int], share: float) -> Rectangle:
    """Return a part of the photo around a place; its sides are a share of the photo's."""
    x, y, width, height = place
    w = max(round(shape[1] * share), width)
    h = max(round(shape[0] * share), height)
    left = min(max(x + (width - w) // 2, 0), shape[1] - w)
    top = min(max(y + (height - h) // 2, 0), shape[0] - h)
    return left, top, w, h


def _fitted(
    make: Callable[[float], list[Picture]], limit: float, share: float
) -> tuple[list[Encoded], float]:
    """Encode pictures in at most `limit` bytes: at lower quality, then at a smaller size.

    Returns
    -------
    encoded : list of Encoded
        All of one size and quality; more bytes than the limit only if they get no smaller.
    share : float
        The share of the size at which they fit; `make` takes it.

    """
    pictures = make(share)
    qualities = _QUALITIES
    while True:
        for quality in qualities:
            encoded = [_jpeg(picture, quality) for picture in pictures]
            if sum(len(each.data) for each in encoded) <= limit:
                return encoded, share
        if qualities == _LAST_QUALITIES:
            return encoded, share
        smaller = make(_SHRINK * share)
        if smaller[0].shape == pictures[0].shape or max(smaller[0].shape) < _LEAST_SIDE:
            qualities = _LAST_QUALITIES
        else:
            pictures, share = smaller, _SHRINK * share


def _jpeg(picture: Picture, quality: int) -> Encoded:
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "JPEG", quality=quality, optimize=True)
    return Encoded(stream.getvalue(), picture.shape[1], picture.shape[0])


def _drawn(kernel: RotationKernel) -> Encoded:
    """Draw the kernel's local filters, in few greys."""
    heavy = kernel.above(_FAINT)
    picture = render_filters(heavy, _FILTERS, _FILTERS, size=_KERNEL_SIDE)
    grey = Image.fromarray(picture).convert("L").quantize(_KERNEL_COLOURS)
    stream = io.BytesIO()
    grey.save(stream, "PNG", optimize=True)
    return Encoded(stream.getvalue(), grey.width, grey.height, "png")


def _reduced(photo: Photo, side: int) -> Picture:
    """Return the whole frame as it is shown, its longer side at most `side`.

    Linear light is averaged before it is encoded, so encoding takes the memory of the small frame.
    """
    factor = max(photo.shape) / side
    if factor <= 1:
        return shown(photo)
    height, width = photo.shape
    size = max(round(width / factor), 1), max(round(height / factor), 1)
    return _shown(photo, cv2.resize(photo.pixels, size, interpolation=cv2.INTER_AREA))


def _crop(photo: Photo, part: Rectangle) -> Picture:
    """Return a part at 100 % as it is shown."""
    left, top, width, height = part
    return _shown(photo, photo.pixels[top : top + height, left : left + width])


def _shown(photo: Photo, pixels: NDArray[Any]) -> Picture:
    """Return pixels of a photo as they are shown."""
    contiguous = np.ascontiguousarray(pixels, np.float32)
    return shown(replace(photo, pixels=contiguous, alpha=None, frame=None))


def _resized(picture: Picture, share: float) -> Picture:
    """Reduce a picture to a share of its sides."""
    height, width = (max(round(side * share), 1) for side in picture.shape[:2])
    image = Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS)
    return np.asarray(image)


def _detail(frame: Picture, shape: tuple[int, int]) -> Rectangle:
    """Find the place with most detail: left, top, width and height in pixels of the photo."""
    zoom = shape[1] / frame.shape[1]
    width, height = min(_DETAIL[0], shape[1]), min(_DETAIL[1], shape[0])
    small = max(round(width / zoom), 1), max(round(height / zoom), 1)
    rows, columns = detailed_part(frame, *small)
    left = min(round(columns.start * zoom), shape[1] - width)
    top = min(round(rows.start * zoom), shape[0] - height)
    return left, top, width, height
