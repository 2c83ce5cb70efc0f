from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from deshake.errors import PhotoError
from deshake.formats.opencv import imdecode, imencode

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("depth", [8, 16])
def test_channels_have_the_order_of_rgb(
    make_codes: Callable[..., np.ndarray], channels: int, depth: int
) -> None:
    codes = make_codes(4, 5, channels, depth)
    swapped = codes if channels == 1 else codes[..., [2, 1, 0, 3][:channels]]
    data = cv2.imencode(".png", swapped)[1].tobytes()
    assert np.array_equal(imdecode(data), codes)


def test_rubbish_is_refused_and_opencv_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    whole = cv2.imencode(".tif", np.zeros((9, 9), np.uint16))[1].tobytes()
    for data in (b"rubbish", b"", whole[:20]):
        with pytest.raises(PhotoError):
            imdecode(data)
    assert capfd.readouterr() == ("", "")


def test_blocks_of_metadata_are_written(make_codes: Callable[..., np.ndarray]) -> None:
    codes = make_codes(40, 50, 3)
    blocks = {cv2.IMAGE_METADATA_EXIF: b"II*\0\x08\0\0\0\0\0\0\0\0\0", cv2.IMAGE_METADATA_XMP: b""}
    data = imencode(".png", codes, (), blocks)
    assert np.array_equal(imdecode(data), codes)
    assert data.count(b"eXIf" + blocks[cv2.IMAGE_METADATA_EXIF]) == 1
    assert b"XML:com.adobe.xmp" not in data


def test_pictures_that_cannot_be_encoded_are_refused(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(PhotoError, match="cannot be encoded"):
        imencode(".jp2", np.zeros((5, 5, 3), np.uint8), ())
    assert capfd.readouterr() == ("", "")
