from __future__ import annotations

import io
import struct
import zlib
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from deshake.errors import PhotoError
from deshake.formats.encoding import Decoded, Encoding
from deshake.formats.icc import profile_transfer
from deshake.formats.png import SIGNATURE, decode_png, encode_png
from deshake.formats.transfer import LINEAR, SRGB, Power
from deshake.metadata.metadata import Metadata

if TYPE_CHECKING:
    from collections.abc import Callable


def chunk(name: bytes, content: bytes) -> bytes:
    check = struct.pack(">I", zlib.crc32(name + content))
    return struct.pack(">I", len(content)) + name + content + check


def plain_png(codes: np.ndarray, *between: bytes) -> bytes:
    """Write a PNG without filters, by the letter of the specification."""
    height, width, channels = np.atleast_3d(codes).shape
    depth = 8 * codes.itemsize
    kind = (0, 4, 2, 6)[channels - 1]
    rows = codes.astype(f">u{codes.itemsize}").reshape(height, -1)
    raw = b"".join(b"\0" + row.tobytes() for row in rows)
    header = struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")
    return SIGNATURE + chunk(b"IHDR", header) + b"".join(between) + body


def split(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Split (H, W[, C]) into colours and alpha."""
    if codes.ndim == 2 or codes.shape[2] == 3:
        return codes, None
    colours = codes[..., 0] if codes.shape[2] == 2 else codes[..., :3]
    return np.ascontiguousarray(colours), np.ascontiguousarray(codes[..., -1])


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (70, 67)])
def test_every_kind_is_read_and_written_bit_for_bit(
    make_codes: Callable[..., np.ndarray], channels: int, depth: int, size: tuple[int, int]
) -> None:
    codes = make_codes(70, 67, channels, depth)[: size[0], : size[1]]
    colours, alpha = split(codes)
    for data in (plain_png(codes), encode_png(decode_png(plain_png(codes)))):
        decoded = decode_png(data)
        assert decoded.encoding.depth == depth
        assert decoded.encoding.grey == (channels < 3)
        assert np.array_equal(decoded.codes, colours)
        assert decoded.codes.dtype == codes.dtype
        assert (decoded.alpha is None) == (alpha is None)
        assert alpha is None or np.array_equal(decoded.alpha, alpha)


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_other_readers_read_the_result(
    make_codes: Callable[..., np.ndarray], channels: int, depth: int
) -> None:
    codes = make_codes(130, 41, channels, depth)
    smooth = np.cumsum(codes // 64, 0, codes.dtype)  # uses other filters than noise does
    for picture in (codes, smooth):
        colours, alpha = split(picture)
        encoding = Encoding("PNG", 16 if depth == 16 else 8, grey=channels == 1)
        data = encode_png(Decoded(colours, alpha, encoding, Metadata()))
        read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        read = read if channels == 1 else read[..., [2, 1, 0, 3][:channels]]
        assert np.array_equal(read, picture)
        if depth == 8:
            with Image.open(io.BytesIO(data)) as result:
                assert np.array_equal(np.asarray(result), picture)


def test_filters_make_smooth_pictures_small() -> None:
    y, x = np.mgrid[:128, :128]
    codes = (100 * x + 90 * y + 500).astype(np.uint16)
    encoding = Encoding("PNG", 16, grey=True)
    assert len(encode_png(Decoded(codes, None, encoding, Metadata()))) < 0.05 * codes.nbytes


def test_metadata_and_chunks_are_copied(
    make_codes: Callable[..., np.ndarray],
    make_exif: Callable[..., bytes],
    make_icc: Callable[..., bytes],
    xmp: bytes,
) -> None:
    exif, icc = make_exif(), make_icc(b"curv" + bytes(8))
    packed = b"XML:com.adobe.xmp\0\1\0\0\0" + zlib.compress(xmp)
    extra = [
        chunk(b"pHYs", struct.pack(">IIB", 3000, 3000, 1)),
        chunk(b"tEXt", b"Author\0somebody"),
        chunk(b"tIME", bytes(7)),
        chunk(b"eXIf", exif),
        chunk(b"iCCP", b"p\0\0" + zlib.compress(icc)),
        chunk(b"iTXt", packed),
    ]
    for depth in (8, 16):
        data = encode_png(decode_png(plain_png(make_codes(5, 6, 3, depth), *extra)))
        with Image.open(io.BytesIO(data)) as result:
            assert isinstance(result, PngImagePlugin.PngImageFile)
            result.load()
            assert result.info["exif"].removeprefix(b"Exif\0\0") == exif
            assert result.info["icc_profile"] == icc
            assert result.info["xmp"] == xmp
            assert result.text["Author"] == "somebody"
            assert result.info["dpi"] == pytest.approx((76.2, 76.2))
        assert b"tIME" not in data


def test_profiles_in_texts_count_if_there_are_no_chunks(
    make_codes: Callable[..., np.ndarray], make_exif: Callable[..., bytes]
) -> None:
    exif, iptc = make_exif(orientation=6), b"\x1c\x02\x05\0\x05Title"
    stream = io.BytesIO()
    info = PngImagePlugin.PngInfo()
    for kind, data in (("exif", b"Exif\0\0" + exif), ("iptc", iptc)):
        info.add_text(
            f"Raw profile type {kind}", f"\n{kind}\n{len(data):8}\n{data.hex()}\n", zip=True
        )
    Image.fromarray(make_codes(9, 8)).save(stream, "PNG", pnginfo=info)
    decoded = decode_png(stream.getvalue())
    assert decoded.metadata.exif == exif
    assert decoded.metadata.orientation == 6
    assert decoded.metadata.iptc == iptc
    again = decode_png(encode_png(decoded))
    assert again.metadata.exif == exif
    assert again.metadata.iptc == iptc
    assert b"Raw profile type exif" not in encode_png(decoded)


def test_a_damaged_profile_in_a_text_is_a_text(make_codes: Callable[..., np.ndarray]) -> None:
    for name, content in (
        (b"zTXt", b"Raw profile type exif\0\0rubbish"),
        (b"tEXt", b"Raw profile type exif\0\nexif\n 9\n00\n"),
        (b"tEXt", b"Raw profile type of its own\0text"),
    ):
        decoded = decode_png(plain_png(make_codes(9, 8), chunk(name, content)))
        assert decoded.metadata == Metadata()
        assert content in encode_png(decoded)


def test_of_two_profiles_the_first_counts(make_codes: Callable[..., np.ndarray]) -> None:
    twice = b"".join(chunk(b"iCCP", b"x\0\0" + zlib.compress(item)) for item in (b"one", b"two"))
    assert decode_png(plain_png(make_codes(9, 8), twice)).metadata.icc == b"one"


def test_palettes_and_few_bits_become_eight() -> None:
    stream = io.BytesIO()
    colours = Image.new("P", (4, 4), 1)
    colours.putpalette([0, 0, 0, 10, 20, 30])
    colours.putpixel((0, 0), 0)
    colours.save(stream, "PNG", transparency=0)
    decoded = decode_png(stream.getvalue())
    assert decoded.codes[1, 1].tolist() == [10, 20, 30]
    assert decoded.alpha is not None
    assert (decoded.alpha[0, 0], decoded.alpha[1, 1]) == (0, 255)
    stream = io.BytesIO()
    Image.new("1", (4, 4), 1).save(stream, "PNG")
    decoded = decode_png(stream.getvalue())
    assert decoded.encoding.grey
    assert decoded.codes.tolist() == [[255] * 4] * 4


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_transparent_colour_becomes_alpha(
    make_codes: Callable[..., np.ndarray], channels: int, depth: int
) -> None:
    codes = make_codes(6, 7, channels, depth)
    key = np.atleast_1d(codes[2, 3]).astype(">u2").tobytes()
    decoded = decode_png(plain_png(codes, chunk(b"tRNS", key)))
    assert np.array_equal(decoded.codes, codes)
    assert decoded.alpha is not None
    hit = np.atleast_3d(codes == codes[2, 3]).all(-1)
    assert np.array_equal(decoded.alpha, np.where(hit, 0, np.iinfo(codes.dtype).max))


@pytest.mark.parametrize(
    ("gamma", "extra", "expected"),
    [(45455, b"", SRGB), (100_000, b"", Power(1.0)), (55556, b"sRGB", SRGB), (1, b"", SRGB)],
)
def test_gamma_chunk(
    make_codes: Callable[..., np.ndarray], gamma: int, extra: bytes, expected: object
) -> None:
    chunks = [chunk(b"gAMA", struct.pack(">I", gamma))]
    if extra:
        chunks.append(chunk(extra, b"\0"))
    assert decode_png(plain_png(make_codes(3, 3), *chunks)).encoding.transfer == expected


def test_animation_is_refused() -> None:
    stream = io.BytesIO()
    frames = [Image.new("RGB", (8, 8), colour) for colour in ("red", "blue")]
    frames[0].save(stream, "PNG", save_all=True, append_images=frames[1:])
    with pytest.raises(PhotoError, match="animated"):
        decode_png(stream.getvalue())


@pytest.mark.parametrize("depth", [8, 16])
def test_damage_and_truncation_are_noticed(
    make_codes: Callable[..., np.ndarray], depth: int
) -> None:
    data = plain_png(make_codes(40, 40, 3, depth))
    for size in (8, 20, 33, 60, len(data) // 2, len(data) - 13, len(data) - 1):
        with pytest.raises(PhotoError):
            decode_png(data[:size])
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 1
    with pytest.raises(PhotoError, match="checksum"):
        decode_png(bytes(flipped))


@pytest.mark.parametrize("depth", [8, 16])
def test_a_picture_that_ends_too_soon_is_noticed(
    make_codes: Callable[..., np.ndarray], depth: int, capfd: pytest.CaptureFixture[str]
) -> None:
    data = plain_png(make_codes(40, 40, 3, depth))
    at = data.index(b"IDAT") - 4
    body = data[at + 8 : -16]
    for cut in (body[: len(body) // 2], zlib.compress(bytes(1000))):
        with pytest.raises(PhotoError):
            decode_png(data[:at] + chunk(b"IDAT", cut) + chunk(b"IEND", b""))
    assert capfd.readouterr() == ("", "")


def test_bombs_are_refused(make_codes: Callable[..., np.ndarray]) -> None:
    data = plain_png(make_codes(4, 4))
    header = struct.pack(">IIBBBBB", 40_000, 25_000, 8, 2, 0, 0, 0)
    with pytest.raises(PhotoError, match="40000 x 25000 pixels"):
        decode_png(SIGNATURE + chunk(b"IHDR", header) + data[33:])
    grown = chunk(b"iCCP", b"p\0\0" + zlib.compress(bytes(100 << 20), 9))
    with pytest.raises(PhotoError, match="metadata"):
        decode_png(plain_png(make_codes(4, 4), grown))


def test_code_points_overrule_profile_and_gamma(make_icc: Callable[..., bytes]) -> None:
    stream = io.BytesIO()
    linear = make_icc(b"curv" + bytes(8))
    Image.fromarray(np.full((4, 4, 3), 99, np.uint8)).save(stream, "PNG", icc_profile=linear)
    data = stream.getvalue()

    def with_chunk(name: bytes, content: bytes) -> bytes:
        chunk = struct.pack(">I", len(content)) + name + content
        return data[:33] + chunk + struct.pack(">I", zlib.crc32(chunk[4:])) + data[33:]

    assert profile_transfer(decode_png(data).metadata.icc) is LINEAR
    p3 = decode_png(with_chunk(b"cICP", bytes([12, 13, 0, 1])))
    assert profile_transfer(p3.metadata.icc) is SRGB
    assert p3.encoding.carried.count(b"cICP") == 1
    with pytest.raises(PhotoError, match="HDR"):
        decode_png(with_chunk(b"cICP", bytes([9, 16, 0, 1])))
    odd = decode_png(with_chunk(b"cICP", b"\x0c"))  # too short to mean anything
    assert profile_transfer(odd.metadata.icc) is LINEAR
