"""How a file stores its pixels, so that the result can be stored in the same way."""

from __future__ import annotations

import contextlib
import struct
import warnings
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, TypeVar

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
    "DAMAGED",
    "ENDINGS",
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

ENDINGS: dict[Format, str] = {form: suffix for suffix, form in reversed(SUFFIXES.items())}
"""The usual ending of each format that is written."""

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
"""Endings of the results of formats that are only read."""

MAX_PIXELS = 300_000_000
"""Pixels of the largest picture that is decoded: 1.5 times those of a 200 MP camera."""

DAMAGED: Final = "copy it again from the camera or its card, or take another copy of it"
"""The hint for a damaged photo."""
_SMALLER: Final = "reduce it in another program first"

_LARGE = 16_000_000  # pixels
_PIXELS_A_BYTE = 100  # more, in a large picture, are an error
_MEGAPIXEL = 1_000_000  # pixels
_STATED_A_BYTE = 500  # of a file of boxes: more, in a large picture, are an error


@dataclass(frozen=True)
class Encoding:
    """How a file stores its pixels.

    Parameters
    ----------
    format : {"JPEG", "PNG", "TIFF", "WEBP", "AVIF", "JPEG2000", "HEIF", "RAW"}
        The file format.
    depth : {8, 16, 32}
        Bits a sample; 32 means floating-point numbers, in linear light if no profile states
        another curve.
    bits : int
        Bits a sample in the file, if they are fewer than the depth of 16; 0: the depth.
    grey : bool
        Whether there is one channel; else there are three.
    transfer : Transfer
        The curve from codes to linear light.
    certain : bool
        Whether this curve is certain: the caller stated it, or a blur showed it.
    quantisation : tuple of tuples of int
        JPEG quantisation tables; empty: those of the quality.
    quality : int
        Quality of a JPEG without tables of its own, 1..100.
    subsampling : {0, 1, 2}
        JPEG chroma subsampling: 4:4:4, 4:2:2, 4:2:0.
    progressive : bool
        Whether a JPEG is progressive.
    lossless : bool
        Whether a WebP is lossless.
    compressed : bool
        Whether a TIFF is compressed. A compressed result always uses deflate.
    premultiplied : bool
        Whether a TIFF's colours are multiplied by its alpha; they stay so.
    matrix : 3 x 3 tuple of float, or None
        Converts the photo's colours, those of the sensor, to the colours of the result's file.
    balance : tuple of float
        The white balance of a RAW file: the gains of its channels, the smallest 1.
    carried : bytes
        Blocks that are copied unchanged to a result of the same format: JPEG segments (comments,
        old image resources), PNG chunks (texts, chromaticities), JPEG 2000 boxes, or the reference
        black and white of an RGB TIFF.

    """

    format: Format
    depth: Depth = 8
    bits: int = 0
    grey: bool = False
    transfer: Transfer = SRGB
    certain: bool = False
    quantisation: tuple[tuple[int, ...], ...] = ()
    quality: int = 95
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
    """The content of a file as stored: codes, not yet turned upright.

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
        For a RAW file, whose codes are linear light: where the sensor was at its white level.
    notes : tuple of str
        What else the file holds and a result does not, in plain words.
    frame : bytes
        The compressed picture of a JPEG (`jpeg_frame`), written instead of the codes if they are
        unchanged; empty: there is none.

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
        The size that its header states.
    packed : int
        Bytes of the file. A small file that states a huge picture is damaged or malicious.

    Raises
    ------
    PhotoError
        If it has no pixels, more than `MAX_PIXELS`, or if it is large and has more than 100
        pixels a byte, as no photo has.

    """
    if height < 1 or width < 1:
        raise PhotoError("the picture has no pixels", hint=DAMAGED)
    if height * width > MAX_PIXELS:
        raise PhotoError(
            f"{width} x {height} pixels are more than the {MAX_PIXELS // 10**6} million allowed",
            hint=_SMALLER,
        )
    if height * width > max(_LARGE, _PIXELS_A_BYTE * packed):
        raise PhotoError(
            f"{width} x {height} pixels in {packed} bytes: damaged, or no photo", hint=DAMAGED
        )


def check_stated_size(height: int, width: int, packed: int) -> None:
    """Refuse a stated size that the stored pixels cannot have.

    In a file of boxes (AVIF, HEIC), the decoder scales the picture to the stated size: a few bytes
    could become megapixels.

    Parameters
    ----------
    height, width : int
        The size that the boxes state.
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
        raise PhotoError(
            f"{width} x {height} pixels in {packed} bytes: damaged, or no photo", hint=DAMAGED
        )


def turned(array: NDArray[T], orientation: int) -> NDArray[T]:
    """Turn a stored array (H, W, ...) upright, by its EXIF orientation."""
    if orientation >= 5:  # exchange rows and columns first
        array = array.swapaxes(0, 1)
    if orientation in {3, 4, 7, 8}:
        array = array[::-1]
    if orientation in {2, 3, 6, 7}:
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


@contextlib.contextmanager
def decoding(what: str) -> Iterator[None]:
    """Turn any error that a decoder raises on a damaged file into a `PhotoError`.

    Warnings are dropped: a file is either read whole or refused.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except PhotoError:
        raise
    except Image.DecompressionBombError as error:
        raise PhotoError(f"the {what} has too many pixels", hint=_SMALLER) from error
    except MemoryError as error:
        raise PhotoError(f"the {what} does not fit into memory", hint=_SMALLER) from error
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
        raise PhotoError(f"the {what} is damaged or cut short", hint=DAMAGED) from error
