from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from deshake.errors import PhotoError
from deshake.formats.encoding import Decoded, Encoding
from deshake.formats.webp import decode_webp, encode_webp
from deshake.metadata.metadata import Metadata

if TYPE_CHECKING:
    from collections.abc import Callable


def webp(codes: np.ndarray, **options: Any) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(codes).save(stream, "WEBP", **options)
    return stream.getvalue()


@pytest.mark.parametrize("channels", [3, 4])
def test_lossless_stays_lossless_to_the_bit(
    make_codes: Callable[..., np.ndarray], channels: int
) -> None:
    codes = make_codes(20, 30, channels)
    decoded = decode_webp(webp(codes, lossless=True, exact=True))
    assert decoded.encoding.lossless
    assert np.array_equal(decoded.codes, codes[..., :3])
    with Image.open(io.BytesIO(encode_webp(decoded))) as result:
        assert np.array_equal(np.asarray(result), codes)


def test_lossy_stays_lossy_and_close_with_its_alpha_intact(
    make_codes: Callable[..., np.ndarray],
) -> None:
    y, x = np.mgrid[:40, :60]
    alpha = make_codes(40, 60)
    codes = np.stack([4 * x, 6 * y, 2 * (x + y), alpha], -1).astype(np.uint8)
    codes[..., 3] |= 128
    decoded = decode_webp(webp(codes, quality=90, exact=True))
    assert not decoded.encoding.lossless
    assert np.array_equal(decoded.alpha, codes[..., 3])
    data = encode_webp(decoded)
    assert b"VP8 " in data
    with Image.open(io.BytesIO(data)) as result:
        assert np.array_equal(np.asarray(result)[..., 3], codes[..., 3])
        assert np.abs(np.asarray(result)[..., :3].astype(int) - decoded.codes).mean() < 3


def test_metadata_are_copied_byte_for_byte(
    make_exif: Callable[..., bytes], make_icc: Callable[..., bytes], xmp: bytes
) -> None:
    exif, icc = make_exif(), make_icc(b"curv" + bytes(8))
    data = webp(np.zeros((8, 8, 3), np.uint8), exif=exif, icc_profile=icc, xmp=xmp)
    with Image.open(io.BytesIO(encode_webp(decode_webp(data)))) as result:
        assert result.info["exif"] == exif
        assert result.info["icc_profile"] == icc
        assert result.info["xmp"] == xmp


def test_grey_is_written_as_rgb(make_codes: Callable[..., np.ndarray]) -> None:
    codes = make_codes(8, 9)
    data = encode_webp(Decoded(codes, None, Encoding("WEBP", lossless=True), Metadata()))
    assert np.array_equal(decode_webp(data).codes, np.dstack([codes] * 3))


def test_animation_truncation_and_size_are_refused(make_codes: Callable[..., np.ndarray]) -> None:
    stream = io.BytesIO()
    frames = [Image.new("RGB", (8, 8), colour) for colour in ("red", "blue")]
    frames[0].save(stream, "WEBP", save_all=True, append_images=frames[1:])
    with pytest.raises(PhotoError, match="animated"):
        decode_webp(stream.getvalue())
    data = webp(make_codes(40, 40, 3))
    for size in (4, 12, 30, len(data) // 2, len(data) - 4):
        with pytest.raises(PhotoError):
            decode_webp(data[:size])
    long = Decoded(np.zeros((1, 16384, 3), np.uint8), None, Encoding("WEBP"), Metadata())
    with pytest.raises(PhotoError, match="16383"):
        encode_webp(long)
