from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from deshake.errors import PhotoError
from deshake.io.opencv import imdecode

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("depth", [8, 16])
def test_channels_come_in_the_order_of_rgb(
    make_codes: Callable[..., np.ndarray], channels: int, depth: int
) -> None:
    codes = make_codes(4, 5, channels, depth)
    swapped = codes if channels == 1 else codes[..., [2, 1, 0, 3][:channels]]
    data = cv2.imencode(".png", swapped)[1].tobytes()
    assert np.array_equal(imdecode(data), codes)


def test_rubbish_is_refused_without_a_word_of_opencvs(capfd: pytest.CaptureFixture[str]) -> None:
    whole = cv2.imencode(".tif", np.zeros((9, 9), np.uint16))[1].tobytes()
    for data in (b"rubbish", b"", whole[:20]):
        with pytest.raises(PhotoError):
            imdecode(data)
    assert capfd.readouterr() == ("", "")
