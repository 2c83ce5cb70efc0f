"""How a file holds its pixels, so that a result can be written the same way."""

from __future__ import annotations

import contextlib
import struct
import warnings
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from PIL import Image

from deshake.errors import PhotoError
from deshake.io.transfer import SRGB

if TYPE_CHECKING:
    from collections.abc import Iterator

    from deshake.io.metadata import Metadata
    from deshake.io.transfer import Codes, Depth, Transfer

__all__ = ["MAX_PIXELS", "SUFFIXES", "Decoded", "Encoding", "Format", "check_size", "decoding"]

Format = Literal["JPEG", "PNG", "TIFF", "WEBP"]

SUFFIXES: dict[str, Format] = {
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".jpe": "JPEG",
    ".png": "PNG",
    ".tif": "TIFF",
    ".tiff": "TIFF",
    ".webp": "WEBP",
}

MAX_PIXELS = 300_000_000
"""Pixels of the largest picture that is decoded: half as many again as a 200 MP camera's."""


@dataclass(frozen=True)
class Encoding:
    """The way a file holds its pixels.

    Parameters
    ----------
    format : {"JPEG", "PNG", "TIFF", "WEBP"}
        The file format.
    depth : {8, 16}
        Bits a sample.
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
    carried : bytes
        Blocks of the same format that are copied as they are: JPEG segments (IPTC, comments,
        extended XMP) or PNG chunks (texts, density, chromaticities).

    """

    format: Format
    depth: Depth = 8
    grey: bool = False
    transfer: Transfer = SRGB
    quantisation: tuple[tuple[int, ...], ...] = ()
    subsampling: int = 0
    progressive: bool = False
    lossless: bool = False
    compressed: bool = False
    premultiplied: bool = False
    carried: bytes = b""


@dataclass(frozen=True)
class Decoded:
    """A file's content as the file has it: codes, not yet turned upright.

    Parameters
    ----------
    codes : (H, W) or (H, W, 3) array of uint8 or uint16
        The pixels.
    alpha : (H, W) array of the same type, or None
        The opacity.
    encoding : Encoding
        How the file holds them.
    metadata : Metadata
        The metadata blocks.

    """

    codes: Codes
    alpha: Codes | None
    encoding: Encoding
    metadata: Metadata


def check_size(height: int, width: int) -> None:
    """Refuse a picture that is empty or too large, before anything is allocated for it.

    Raises
    ------
    PhotoError
        If it has no pixels, or more than `MAX_PIXELS`.

    """
    if height < 1 or width < 1:
        raise PhotoError("the picture has no pixels")
    if height * width > MAX_PIXELS:
        raise PhotoError(
            f"{width} x {height} pixels are more than the {MAX_PIXELS // 10**6} million allowed"
        )


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
