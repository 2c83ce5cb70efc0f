"""A photo: pixels in linear light, read from a file with all that a file of it needs."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deshake.errors import PhotoError
from deshake.files.disk import read_bytes
from deshake.formats.avif import decode_avif
from deshake.formats.camera_curve import CameraCurve, light_before, light_behind
from deshake.formats.encoding import Decoded, Encoding, turned
from deshake.formats.heif import decode_heif
from deshake.formats.icc import profile_transfer
from deshake.formats.jpeg import decode_jpeg
from deshake.formats.jpeg2000 import decode_jpeg2000
from deshake.formats.jpeg_frame import Frame
from deshake.formats.png import decode_png
from deshake.formats.raw import decode_raw
from deshake.formats.signatures import photo_format
from deshake.formats.tiff import decode_tiff
from deshake.formats.transfer import (
    LINEAR,
    NAMED,
    clipped_pixels,
    decode,
    display_values,
    linear_light,
    reduced_light,
)
from deshake.formats.webp import decode_webp
from deshake.metadata.profiles import linear_profile

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from deshake.formats.encoding import Format
    from deshake.formats.transfer import Codes, TransferName
    from deshake.metadata.metadata import Metadata

__all__ = ["Photo", "balanced", "read_pair", "read_photo"]

_MAX_BYTES = 4 << 30  # a larger file is an error
_DECODERS: dict[Format, Callable[[bytes], Decoded]] = {
    "JPEG": decode_jpeg,
    "PNG": decode_png,
    "TIFF": decode_tiff,
    "WEBP": decode_webp,
    "AVIF": decode_avif,
    "JPEG2000": decode_jpeg2000,
    "HEIF": decode_heif,
    "RAW": decode_raw,
}


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo, upright, in linear light.

    Parameters
    ----------
    pixels : (H, W) or (H, W, 3) array of float32
        Linear light. 1 is the file's white: the file clips there, and so does a result in a
        format of integers. The pixels of a RAW file are the sensor's colours, white-balanced.
    clipped : (H, W) array of bool
        True where any channel of the input has its largest value (see `transfer.is_clipped`) or
        the sensor's white level.
    alpha : (H, W) array of uint8 or uint16, or None
        Opacity in the file's depth; it is copied bit for bit.
    encoding : Encoding
        How the file held the pixels.
    metadata : Metadata
        EXIF, XMP and ICC, with the orientation set to 1.
    source : Path
        The file. For a photo that was made in memory: its name in messages.
    notes : tuple of str
        What the file holds and a result does not, in plain words.
    frame : Frame, optional
        The compressed picture of a JPEG that was stored upright.
    sha256 : str, optional
        The SHA-256 of the bytes that were read, in hexadecimal; a photo that was made in memory
        has none.
    stored_turned : bool
        Whether the file stores the photo on its side: reading it exchanged width and height.

    Examples
    --------
    >>> import numpy as np
    >>> import deshake
    >>> deshake.write_photo("grey.png", np.full((40, 60), 0.2))
    >>> photo = deshake.read_photo("grey.png")
    >>> brighter = photo.with_pixels(2 * photo.pixels)  # format and metadata stay
    >>> photo.shape, round(float(brighter.pixels.max()), 3)
    ((40, 60), 0.4)

    """

    pixels: NDArray[np.float32]
    clipped: NDArray[np.bool_]
    alpha: Codes | None
    encoding: Encoding
    metadata: Metadata
    source: Path
    notes: tuple[str, ...] = ()
    frame: Frame | None = None
    sha256: str | None = None
    stored_turned: bool = False

    @property
    def is_sensors(self) -> bool:
        """Whether the pixels are a sensor's own values, without a tone curve."""
        return self.encoding.format == "RAW"

    @property
    def may_be_toned(self) -> bool:
        """Whether a camera may have given the photo a tone curve that its file does not state.

        Then the pixels are linear light only approximately.
        """
        return not (self.is_sensors or self.encoding.certain or self.encoding.transfer == LINEAR)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.pixels.shape[0], self.pixels.shape[1]

    @property
    def described_size(self) -> str:
        """Width and height of the upright photo, in words."""
        size = f"{self.shape[1]} x {self.shape[0]} pixels"
        return f"{size} upright (it is stored turned)" if self.stored_turned else size

    def with_pixels(self, pixels: NDArray[np.floating]) -> Photo:
        """Return the photo with other pixels of the same shape.

        Raises
        ------
        ValueError
            If the shape differs.

        """
        if pixels.shape != self.pixels.shape:
            msg = f"pixels of shape {pixels.shape} for a photo of shape {self.pixels.shape}"
            raise ValueError(msg)
        return replace(self, pixels=np.asarray(pixels, np.float32), frame=None)

    def in_certain_light(self) -> Photo:
        """Return the photo as one whose curve is certain: its pixels are linear light."""
        return replace(self, encoding=replace(self.encoding, certain=True))

    def in_display_values(self) -> Photo:
        """Return the photo with display values, those of its file, in the place of linear light.

        It is the photo that a file gives whose values stand for light.
        """
        encoding = replace(self.encoding, transfer=LINEAR)
        values = display_values(self.pixels, self.encoding.transfer)
        return replace(self.with_pixels(values), encoding=encoding)

    def without_camera_curve(self) -> Photo:
        """Return the photo in the light before the tone curve that cameras commonly apply."""
        transfer = CameraCurve(self.encoding.transfer)
        encoding = replace(self.encoding, transfer=transfer, certain=True)
        return replace(self.with_pixels(light_before(self.pixels)), encoding=encoding)

    def with_tones_of(self, photo: Photo) -> Photo:
        """Undo the change of the tones of the photo that led to this one.

        It is `in_display_values`, `without_camera_curve` or `in_certain_light`.
        """
        if self.encoding == photo.encoding:
            return self
        own, curve = self.encoding.transfer, photo.encoding.transfer
        light = self
        if own == CameraCurve(curve):
            light = self.with_pixels(light_behind(self.pixels))
        elif own != curve:
            light = self.with_pixels(linear_light(self.pixels, curve))
        return replace(light, encoding=photo.encoding)

    def with_jpeg_quality(self, quality: int) -> Photo:
        """Return the photo with another quality, 1..100, for a JPEG; other formats ignore it.

        The JPEG has the tables of this quality, and is encoded also if no pixel changes.
        """
        encoding = replace(self.encoding, quality=quality, quantisation=())
        return replace(self, encoding=encoding, frame=None)

    def in_linear_light(self) -> Photo:
        """Return a RAW photo that will be encoded in linear light and in the sensor's colours.

        Its ICC profile describes these colours.

        Raises
        ------
        PhotoError
            If the photo is no RAW file.

        """
        encoding = self.encoding
        if encoding.format != "RAW":
            raise PhotoError(
                "--linear is for RAW files, and this is none",
                hint="leave --linear out",
                file=self.source,
            )
        icc = linear_profile(encoding.matrix, grey=encoding.grey)
        return replace(
            self,
            encoding=replace(encoding, transfer=LINEAR, matrix=None),
            metadata=replace(self.metadata, icc=icc),
        )


def read_photo(
    path: str | os.PathLike[str],
    *,
    transfer: TransferName | None = None,
    luma: bool = False,
    reduction: Callable[[NDArray[np.float32]], NDArray[np.float32]] | None = None,
) -> Photo:
    """Read a photo and turn it upright.

    The content of the file decides its format; the name matters for RAW files alone.

    Parameters
    ----------
    path : path
        The file.
    transfer : {"srgb", "linear", "gamma22"}, optional, keyword-only
        The file's transfer curve. By default that of its ICC profile if it has a simple one,
        else what a PNG's chunks say, else sRGB. A RAW file is linear and takes none.
    luma : bool, keyword-only
        Whether the luma of a JPEG is enough: the photo is then grey, and read faster. Photos of
        other formats keep their colours.
    reduction : callable, optional, keyword-only
        A function such as `luminance`, from linear light (H, W) or (H, W, 3) to grey (H, W). It is
        applied to bands of rows, so the colours of the whole photo never stand in memory. Such a
        photo has no frame.

    Raises
    ------
    PhotoError
        If the file does not exist, has no known format, is damaged or cut short, holds more than
        one picture, has more than `encoding.MAX_PIXELS` pixels, or is neither grey nor RGB.

    Examples
    --------
    >>> import numpy as np
    >>> import deshake
    >>> deshake.write_photo("grey.png", np.full((40, 60), 0.2))
    >>> photo = deshake.read_photo("grey.png")
    >>> photo.pixels.dtype, photo.pixels.shape, round(float(photo.pixels[0, 0]), 3)
    (dtype('float32'), (40, 60), 0.2)

    """
    if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):  # noqa: PTH110, PTH112, PTH113
        raise PhotoError("is no ordinary file", hint="name a photo", file=path)
    data = read_bytes(path, _MAX_BYTES, PhotoError)
    try:
        form = photo_format(data, Path(path).suffix)
        decoded = decode_jpeg(data, luma=True) if luma and form == "JPEG" else _DECODERS[form](data)
        encoding = _encoding(decoded, transfer)
    except PhotoError as error:
        error.file = os.fspath(path)
        raise
    turn = decoded.metadata.orientation
    codes = turned(decoded.codes, turn)
    curve = LINEAR if encoding.format == "RAW" else encoding.transfer
    pixels = decode(codes, curve) if reduction is None else reduced_light(codes, curve, reduction)
    saturated = None if decoded.saturated is None else turned(decoded.saturated, turn)
    has_frame = bool(decoded.frame) and turn == 1 and reduction is None
    return Photo(
        pixels=pixels,
        clipped=clipped_pixels(codes, saturated),
        alpha=None if decoded.alpha is None else turned(decoded.alpha, turn),
        encoding=encoding,
        metadata=decoded.metadata.upright(),
        source=Path(path),
        notes=decoded.notes,
        frame=Frame(decoded.frame, pixels) if has_frame else None,
        sha256=hashlib.sha256(data).hexdigest(),
        stored_turned=turn >= 5,
    )


def read_pair(
    first: str | os.PathLike[str],
    second: str | os.PathLike[str],
    *,
    transfer: TransferName | None = None,
) -> tuple[Photo, Photo]:
    """Read two photos of one scene as `read_photo` does.

    If both are RAW files, the second one gets the white balance of the first one.
    """
    one, other = (read_photo(path, transfer=transfer) for path in (first, second))
    return one, balanced(other, one)


def balanced(photo: Photo, reference: Photo) -> Photo:
    """Return a RAW photo with the white balance of another one; else return the photo."""
    own, wanted = photo.encoding.balance, reference.encoding.balance
    if not wanted or len(wanted) != len(own) or wanted == own:
        return photo
    gains = np.divide(wanted, own).astype(np.float32)
    encoding = replace(photo.encoding, balance=wanted)
    return replace(photo.with_pixels(photo.pixels * gains), encoding=encoding)


def _encoding(decoded: Decoded, transfer: TransferName | None) -> Encoding:
    """Return how the results of a file are encoded."""
    encoding = decoded.encoding
    if encoding.format == "RAW":
        if transfer is not None:
            raise PhotoError(
                "--transfer is not for RAW files, which are in linear light",
                hint="leave --transfer out; --linear writes the result in linear light",
            )
        return encoding
    if transfer is not None:
        return replace(encoding, transfer=NAMED[transfer], certain=True)
    curve = profile_transfer(decoded.metadata.icc)
    return encoding if curve is None else replace(encoding, transfer=curve)
