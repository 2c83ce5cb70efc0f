from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from deshake.errors import PhotoError
from deshake.io.jpeg import decode_jpeg, encode_jpeg

if TYPE_CHECKING:
    from collections.abc import Callable

IPTC = b"Photoshop 3.0\x008BIM\x04\x04\x00\x00\x00\x00\x00\x04\x1c\x02\x00\x00"


def jpeg(codes: np.ndarray, **options: Any) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(codes).save(stream, "JPEG", **options)
    return stream.getvalue()


def smooth(height: int = 40, width: int = 56) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return np.stack([4 * x + 20, 5 * y + 20, 3 * (x + y)], -1).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("subsampling", [0, 1, 2])
@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("grey", [False, True])
def test_tables_and_subsampling_are_the_sources(
    subsampling: int, *, progressive: bool, grey: bool
) -> None:
    codes = smooth()[..., 0] if grey else smooth()
    data = jpeg(codes, quality=83, subsampling=subsampling, progressive=progressive)
    decoded = decode_jpeg(data)
    with Image.open(io.BytesIO(data)) as source:
        assert np.array_equal(decoded.codes, np.asarray(source))
        again = encode_jpeg(decoded)
        with Image.open(io.BytesIO(again)) as result:
            assert result.mode == source.mode == ("L" if grey else "RGB")
            assert result.quantization == source.quantization
            assert grey or result.layer == source.layer
            assert result.info.get("progressive") == source.info.get("progressive")
            assert np.abs(np.asarray(result).astype(int) - decoded.codes).mean() < 0.5


def test_metadata_are_carried_byte_for_byte(
    make_exif: Callable[..., bytes], make_icc: Callable[..., bytes], xmp: bytes
) -> None:
    profile = make_icc(b"curv" + bytes(8)) + bytes(range(256)) * 400  # longer than one segment
    exif = make_exif(">")
    extra = b"\xff\xed" + (len(IPTC) + 2).to_bytes(2, "big") + IPTC
    data = jpeg(
        smooth(), exif=b"Exif\0\0" + exif, icc_profile=profile, xmp=xmp, comment=b"hi", extra=extra
    )
    decoded = decode_jpeg(data)
    assert decoded.metadata.exif == exif
    with Image.open(io.BytesIO(encode_jpeg(decoded))) as result:
        assert result.info["exif"] == b"Exif\0\0" + exif
        assert result.info["icc_profile"] == profile
        assert result.info["xmp"] == xmp
        assert result.info["comment"] == b"hi"
        assert dict(result.applist)["APP13"] == IPTC


def test_the_first_of_several_pictures_is_taken() -> None:
    stream = io.BytesIO()
    first = Image.fromarray(smooth())
    first.save(stream, "MPO", save_all=True, append_images=[Image.new("RGB", (56, 40), "red")])
    decoded = decode_jpeg(stream.getvalue())
    assert np.abs(decoded.codes.astype(int) - smooth()).mean() < 5
    with Image.open(io.BytesIO(encode_jpeg(decoded))) as result:
        assert result.format == "JPEG"


def test_cmyk_is_refused_with_a_hint() -> None:
    stream = io.BytesIO()
    Image.new("CMYK", (8, 8)).save(stream, "JPEG")
    with pytest.raises(PhotoError, match="CMYK") as caught:
        decode_jpeg(stream.getvalue())
    assert "RGB" in str(caught.value.hint)


@pytest.mark.parametrize("progressive", [False, True])
def test_a_truncated_file_is_never_half_grey(*, progressive: bool) -> None:
    rng = np.random.default_rng(1)
    codes = rng.integers(0, 256, (64, 64, 3)).astype(np.uint8)
    data = jpeg(codes, progressive=progressive)
    for share in (0.05, 0.3, 0.6, 0.9, 0.98):
        with pytest.raises(PhotoError, match="cut short"):
            decode_jpeg(data[: int(share * len(data))])


def test_a_bomb_is_refused_by_its_header() -> None:
    data = jpeg(np.zeros((8, 8), np.uint8))
    at = data.index(b"\xff\xc0")
    bomb = data[: at + 5] + b"\xff\xdc\xff\xdc" + data[at + 9 :]
    with pytest.raises(PhotoError, match="65500 x 65500 pixels"):
        decode_jpeg(bomb)


def test_blocks_too_large_for_a_segment_are_refused() -> None:
    decoded = decode_jpeg(jpeg(smooth()))
    object.__setattr__(decoded.metadata, "exif", bytes(70_000))
    with pytest.raises(PhotoError, match="EXIF block does not fit"):
        encode_jpeg(decoded)
