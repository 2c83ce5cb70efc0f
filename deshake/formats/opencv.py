"""OpenCV's codecs, for files of more than 8 bits, which Pillow would silently reduce to 8."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, cast

import cv2
import numpy as np
from cv2.utils import logging

from deshake.errors import PhotoError
from deshake.formats.encoding import DAMAGED

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from deshake.formats.transfer import Codes

__all__ = ["imdecode", "imencode"]

_SWAPPED = [2, 1, 0, 3]  # from RGB to BGR, and back


def imdecode(data: bytes) -> Codes:
    """Decode a picture as stored: neither turned by EXIF nor reduced to 8 bits.

    Parameters
    ----------
    data : bytes
        A file of a format that OpenCV knows.

    Returns
    -------
    (H, W) or (H, W, C) array of uint8 or uint16
        Grey, RGB or RGBA. (OpenCV's own order is BGR; grey with alpha becomes RGBA.)

    Raises
    ------
    PhotoError
        If OpenCV cannot decode it.

    """
    with _silent():  # a damaged file is reported once, by the error raised here
        try:
            pixels: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            raise PhotoError(
                "the picture is damaged or of an unknown kind", hint=DAMAGED
            ) from error
    if pixels is None or pixels.dtype not in {np.dtype(np.uint8), np.dtype(np.uint16)}:
        raise PhotoError("the picture is damaged or of an unknown kind", hint=DAMAGED)
    codes = cast("Codes", pixels)
    if codes.ndim == 3:
        codes = np.ascontiguousarray(codes[..., _SWAPPED[: codes.shape[2]]])
    return codes


def imencode(
    suffix: str, codes: Codes, options: Sequence[int], metadata: Mapping[int, bytes] | None = None
) -> bytes:
    """Encode a picture with blocks of metadata.

    Parameters
    ----------
    suffix : str
        The ending that stands for the format, such as ".avif".
    codes : (H, W) or (H, W, C) array of uint8 or uint16
        Grey, RGB or RGBA.
    options : sequence of int
        OpenCV's names of options, each with its value.
    metadata : mapping, optional
        Blocks by OpenCV's kinds of metadata; empty ones are ignored.

    Raises
    ------
    PhotoError
        If OpenCV cannot encode it.

    """
    blocks = {kind: block for kind, block in (metadata or {}).items() if block}
    pixels = (
        codes if codes.ndim == 2 else np.ascontiguousarray(codes[..., _SWAPPED[: codes.shape[2]]])
    )
    with _silent():
        try:
            done, data = cv2.imencodeWithMetadata(
                suffix,
                pixels,
                list(blocks),
                [np.frombuffer(block, np.uint8) for block in blocks.values()],
                list(options),
            )
        except cv2.error as error:
            raise PhotoError("the picture cannot be encoded") from error
    if not done:
        raise PhotoError("the picture cannot be encoded")
    return data.tobytes()


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Keep OpenCV from printing errors."""
    level = logging.getLogLevel()
    logging.setLogLevel(0)
    try:
        yield
    finally:
        logging.setLogLevel(level)
