from __future__ import annotations

import struct

import pytest

from deshake.errors import PhotoError
from deshake.formats.encoding import MAX_PIXELS, check_size, decoding


def test_a_large_picture_in_a_small_file_is_refused():
    check_size(4000, 4000, 100)
    check_size(6000, 4000, 240_000)
    with pytest.raises(PhotoError, match="6000 x 4000 pixels in 200000 bytes"):
        check_size(4000, 6000, 200_000)


def test_large_cameras_fit_and_bombs_do_not() -> None:
    check_size(1, 1, 1)
    check_size(12240, 16320, 9_000_000)  # 200 MP
    assert MAX_PIXELS < 10**9
    with pytest.raises(PhotoError, match="pixels are more than"):
        check_size(100_000, 10_000, 1 << 30)
    with pytest.raises(PhotoError, match="no pixels"):
        check_size(0, 5, 100)


@pytest.mark.parametrize("error", [OSError("a\nb"), struct.error("x"), KeyError(3), MemoryError()])
def test_any_error_of_a_decoder_becomes_one_line(error: Exception) -> None:
    with pytest.raises(PhotoError) as caught, decoding("PNG"):
        raise error
    assert "PNG" in caught.value.message
    assert "\n" not in caught.value.message


def test_interrupts_and_own_errors_pass() -> None:
    with pytest.raises(KeyboardInterrupt), decoding("PNG"):
        raise KeyboardInterrupt
    own = PhotoError("own")
    with pytest.raises(PhotoError) as caught, decoding("PNG"):
        raise own
    assert caught.value is own
