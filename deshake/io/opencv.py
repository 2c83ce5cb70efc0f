"""OpenCV's decoder, for the 16-bit files that Pillow would silently cut to 8 bits."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np
from cv2.utils import logging

from deshake.errors import PhotoError

if TYPE_CHECKING:
    from deshake.io.transfer import Codes

__all__ = ["imdecode"]


def imdecode(data: bytes) -> Codes:
    """Decode a picture as it is: neither turned by EXIF nor cut to 8 bits.

    Parameters
    ----------
    data : bytes
        A file of a format that OpenCV knows.

    Returns
    -------
    (H, W) or (H, W, C) array of uint8 or uint16
        Grey, RGB or RGBA. (OpenCV's own order is BGR; grey with alpha comes as RGBA.)

    Raises
    ------
    PhotoError
        If OpenCV cannot decode it.

    """
    level = logging.getLogLevel()
    logging.setLogLevel(0)  # a damaged file is reported once, by the error raised here
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise PhotoError("the picture is damaged or of an unknown kind") from error
    finally:
        logging.setLogLevel(level)
    # The stubs say that there is always a picture; for a damaged file there is none.
    if pixels is None or pixels.dtype not in {np.dtype(np.uint8), np.dtype(np.uint16)}:
        raise PhotoError("the picture is damaged or of an unknown kind")
    codes = cast("Codes", pixels)
    if codes.ndim == 3:
        codes = np.ascontiguousarray(codes[..., [2, 1, 0, 3][: codes.shape[2]]])
    return codes
