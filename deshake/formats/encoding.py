"""How a file holds its pixels, so that a result can be written the same way."""

from __future__ import annotations

import contextlib
import struct
import warnings
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np
from PIL import Image

from deshake.errors import PhotoError
from deshake.formats.transfer import SRGB

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from deshake.formats.transfer import Codes, Depth, Transfer
    from deshake.metadata.metadata import Metadata

__all__ = [
    "MAX_PIXELS",
    "READ_ONLY",
    "SUFFIXES",
    "WRITTEN_AS",
    "Decoded",
    "Encoding",
    "Format",
    "Matrix",
    "check_size",
    "check_stated_size",
    "decoding",
    "turned",
]

T = TypeVar("T", bound=np.generic)

Format = Literal["JPEG", "PNG", "TIFF", "WEBP", "AVIF", "JPEG2000", "HEIF", "RAW"]
Matrix = tuple[tuple[float, float, float], ...]

SUFFIXES: dict[str, Format] = {
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".jpe": "JPEG",
    ".png": "PNG",
    ".tif": "TIFF",
    ".tiff": "TIFF",
    ".webp": "WEBP",
    ".avif": "AVIF",
    ".jp2": "JPEG2000",
}
"""Formats that are read and written, by the ending of the name."""

_RAW_SUFFIXES = (
    *(".dng", ".gpr"),  # any maker's
    *(".cr2", ".cr3", ".crw"),  # Canon
    *(".nef", ".nrw"),  # Nikon
    *(".arw", ".sr2", ".srf", ".mrw"),  # Sony, Minolta
    *(".raf", ".orf", ".rw2"),  # Fujifilm, Olympus, Panasonic
    *(".pef", ".srw", ".rwl"),  # Pentax, Samsung, Leica
    *(".3fr", ".fff", ".iiq", ".mos", ".mef"),  # Hasselblad, Phase One, Leaf, Mamiya
    *(".x3f", ".erf", ".kdc", ".dcr"),  # Sigma, Epson, Kodak
)
READ_ONLY: dict[str, Format] = {
    **dict.fromkeys((".heic", ".heif", ".hif"), "HEIF"),
    **dict.fromkeys(_RAW_SUFFIXES, "RAW"),
}
"""Formats that are only read, by the ending of the name."""

WRITTEN_AS: dict[Format, str] = {"HEIF": ".jpg", "RAW": ".tif"}
"""What the result of a format that is only read ends in."""

MAX_PIXELS = 300_000_000
"""Pixels of the largest picture that is decoded: half as many again as a 200 MP camera's."""

_LARGE = 16_000_000  # pixels
_PIXELS_A_BYTE = 100
_MEGAPIXEL = 1_000_000
_STATED_A_BYTE = 500


@dataclass(frozen=True)
class Encoding:
    """The way a file holds its pixels.

    Parameters
    ----------
    format : {"JPEG", "PNG", "TIFF", "WEBP", "AVIF", "JPEG2000", "HEIF", "RAW"}
        The file format.
    depth : {8, 16, 32}
        Bits a sample; 32 are those of floating-point numbers, in linear light if no profile says
        otherwise.
    bits : int
        Bits a sample that the file really has, where they are fewer than a depth of 16; 0: as many.
    grey : bool
        One channel, or three.
    transfer : Transfer
        The curve from codes to linear light.
    quantisation : tuple of tuples of int
        JPEG quantisation tables; empty: quality 95.
    subsampling : {0, 1, 2}
        JPEG chroma subsampling: 4:4:4, 4:2:2, 4:2:0.
    progressive : bool
        Whether a JPEG is progressive.
    lossless : bool
        Whether a WebP is lossless.
    compressed : bool
        Whether a TIFF is compressed. Whatever the method was, deflate is what is written.
    premultiplied : bool
        Whether a TIFF's colours are multiplied by its alpha; they are carried as they are.
    matrix : 3 x 3 tuple of float, or None
        Turns colours as the photo has them, the sensor's own, into those of the file.
    balance : tuple of float
        By how much the channels of a RAW file were amplified, the least by 1: the white balance.
    carried : bytes
        Blocks of the same format that are copied as they are: JPEG segments (IPTC, comments,
        extended XMP) or PNG chunks (texts, chromaticities);
        of a TIFF in RGB its reference black and white.

    """

    format: Format
    depth: Depth = 8
    bits: int = 0
    grey: bool = False
    transfer: Transfer = SRGB
    quantisation: tuple[tuple[int, ...], ...] = ()
    subsampling: int = 0
    progressive: bool = False
    lossless: bool = False
    compressed: bool = False
    premultiplied: bool = False
    matrix: Matrix | None = None
    balance: tuple[float, ...] = ()
    carried: bytes = b""


@dataclass(frozen=True)
class Decoded:
    """A file's content as the file has it: codes, not yet turned upright.

    Parameters
    ----------
    codes : (H, W) or (H, W, 3) array of uint8, uint16 or float32
        The pixels.
    alpha : (H, W) array of the same type, or None
        The opacity.
    encoding : Encoding
        How the file holds them.
    metadata : Metadata
        The metadata blocks.
    saturated : array of bool, as `codes`, or None
        Of a RAW file, whose codes are in linear light: where the sensor was at its white level.
    notes : tuple of str
        What else the file holds that a result will lack, in plain words.
    frame : bytes
        The compressed picture of a JPEG (`jpeg_frame`), to be written instead of the codes where
        they are still its own; empty: there is none.

    """

    codes: Codes
    alpha: Codes | None
    encoding: Encoding
    metadata: Metadata
    saturated: NDArray[np.bool_] | None = None
    notes: tuple[str, ...] = ()
    frame: bytes = b""


def check_size(height: int, width: int, packed: int) -> None:
    """Refuse a picture that is empty or too large, before anything is allocated for it.

    Parameters
    ----------
    height, width : int
        What its header says.
    packed : int
        Bytes of the file. A small file that says to be a huge picture is damaged or made to harm.

    Raises
    ------
    PhotoError
        If it has no pixels, more than `MAX_PIXELS`, or if it is large and has more than 100
        pixels a byte, as no photo has.

    """
    if height < 1 or width < 1:
        raise PhotoError("the picture has no pixels")
    if height * width > MAX_PIXELS:
        raise PhotoError(
            f"{width} x {height} pixels are more than the {MAX_PIXELS // 10**6} million allowed"
        )
    if height * width > max(_LARGE, _PIXELS_A_BYTE * packed):
        raise PhotoError(f"{width} x {height} pixels in {packed} bytes: damaged, or no photo")


def check_stated_size(height: int, width: int, packed: int) -> None:
    """Refuse a size that stands apart from the pixels, and that they cannot have.

    In a file of boxes (AVIF, HEIC), a picture of another size is scaled to the one that is stated:
    a few bytes become megapixels.

    Parameters
    ----------
    height, width : int
        What the boxes state.
    packed : int
        Bytes of the file.

    Raises
    ------
    PhotoError
        For the reasons of `check_size`, or if there is more than a megapixel and more than 500
        pixels a byte.

    """
    check_size(height, width, packed)
    if height * width > max(_MEGAPIXEL, _STATED_A_BYTE * packed):
        raise PhotoError(f"{width} x {height} pixels in {packed} bytes: damaged, or no photo")


def turned(array: NDArray[T], orientation: int) -> NDArray[T]:
    """Turn an array (H, W, ...) as stored to upright, by its EXIF orientation."""
    if orientation >= 5:  # rows and columns change places first
        array = array.swapaxes(0, 1)
    if orientation in {3, 4, 7, 8}:
        array = array[::-1]
    if orientation in {2, 3, 6, 7}:
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


@contextlib.contextmanager
def decoding(what: str) -> Iterator[None]:
    """Turn whatever a decoder raises on a damaged file into a `PhotoError`.

    Warnings are dropped: a file is either read whole or refused.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except PhotoError:
        raise
    except Image.DecompressionBombError as error:
        raise PhotoError(f"the {what} has too many pixels") from error
    except MemoryError as error:
        raise PhotoError(f"the {what} does not fit into memory") from error
    except (
        OSError,
        SyntaxError,
        ValueError,
        TypeError,
        LookupError,
        ArithmeticError,
        RuntimeError,
        EOFError,
        AttributeError,
        struct.error,
        zlib.error,
    ) as error:
        reason = " ".join(str(error).split())[:120]
        raise PhotoError(f"the {what} is damaged or cut short ({reason})") from error
