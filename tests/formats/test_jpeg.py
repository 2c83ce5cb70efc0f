from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from deshake.errors import PhotoError
from deshake.formats.jpeg import decode_jpeg, encode_jpeg

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
def test_tables_and_subsampling_are_kept(
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


def test_metadata_are_copied_byte_for_byte(
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
def test_a_truncated_file_is_refused(*, progressive: bool) -> None:
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


def segments(*contents: tuple[int, bytes]) -> bytes:
    return b"".join(
        bytes([0xFF, marker]) + (len(content) + 2).to_bytes(2, "big") + content
        for marker, content in contents
    )


def test_of_two_blocks_the_first_counts() -> None:
    """Pillow joins two EXIF blocks, takes the last XMP packet, and of two profiles neither."""
    xmp, icc = b"http://ns.adobe.com/xap/1.0/\0", b"ICC_PROFILE\0\1\1"
    data = jpeg(smooth())
    twice = segments(
        *((0xE1, b"Exif\0\0II*\0" + item) for item in (b"one", b"two")),
        *((0xE1, xmp + item) for item in (b"one", b"two")),
        *((0xE2, icc + item) for item in (b"one", b"two")),
    )
    metadata = decode_jpeg(data[:2] + twice + data[2:]).metadata
    assert (metadata.exif, metadata.xmp, metadata.icc) == (b"II*\0one", b"one", b"one")


def test_exif_in_several_segments_is_joined() -> None:
    data = jpeg(smooth())
    parts = segments((0xE1, b"Exif\0\0II*\0" + bytes(65_000)), (0xE1, b"Exif\0\0rest"))
    assert decode_jpeg(data[:2] + parts + data[2:]).metadata.exif.endswith(bytes(9) + b"rest")


@pytest.mark.parametrize("numbers", [[(1, 2)], [(2, 2)], [(2, 2), (1, 2)], [(0, 0)]])
def test_profiles_with_missing_parts_are_ignored(numbers: list[tuple[int, int]]) -> None:
    data = jpeg(smooth())
    parts = segments(*((0xE2, b"ICC_PROFILE\0" + bytes(pair) + b"part") for pair in numbers))
    whole = set(numbers) == {(1, 2), (2, 2)}
    assert decode_jpeg(data[:2] + parts + data[2:]).metadata.icc == b"partpart" * whole


def test_extended_xmp_is_read_whole_or_not_at_all() -> None:
    guid, more = "0123456789ABCDEF" * 2, bytes(range(256)) * 600
    short = f'<rdf:RDF xmpNote:HasExtendedXMP="{guid}"/>'.encode()
    decoded = decode_jpeg(jpeg(smooth(), xmp=short))
    object.__setattr__(decoded.metadata, "extended_xmp", more)
    data = encode_jpeg(decoded)
    again = decode_jpeg(data)
    assert again.metadata.xmp == short
    assert again.metadata.extended_xmp == more
    lost = data.replace(guid.encode() + len(more).to_bytes(4, "big") + bytes(4), b"x" * 40)
    assert len(lost) == len(data)
    assert decode_jpeg(lost).metadata.extended_xmp == b""
    assert decode_jpeg(lost).notes == ("its extended XMP is damaged, and left out",)
    assert decode_jpeg(data).notes == ()


def test_a_dropped_gain_map_is_noted(make_codes: Callable[..., np.ndarray]) -> None:
    stream = io.BytesIO()
    Image.fromarray(make_codes(16, 16, 3)).save(stream, "JPEG")
    assert decode_jpeg(stream.getvalue()).notes == ()
    second = io.BytesIO()
    packet = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><a hdrgm:Version="1.0"/></x:xmpmeta>'
    Image.fromarray(make_codes(8, 8, 3)).save(second, "JPEG", xmp=packet)
    both = stream.getvalue() + second.getvalue()
    assert decode_jpeg(both).notes == ("its gain map (HDR) is dropped",)
    assert decode_jpeg(both).codes.shape == (16, 16, 3)
