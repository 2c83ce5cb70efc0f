from __future__ import annotations

import io
import struct

import cv2
import numpy as np
import pytest
from PIL import Image

from deshake.errors import PhotoError
from deshake.formats.avif import decode_avif, encode_avif
from deshake.formats.boxes import metadata_items
from deshake.formats.encoding import Decoded, Encoding
from deshake.metadata.metadata import Metadata


def deep(codes, bits):
    """Write an AVIF of 10 or 12 bits by OpenCV, lossless."""
    options = [cv2.IMWRITE_AVIF_DEPTH, bits, cv2.IMWRITE_AVIF_QUALITY, 100]
    return cv2.imencode(".avif", codes[..., ::-1], options)[1].tobytes()


def by_pillow(image, **options):
    stream = io.BytesIO()
    image.save(stream, "AVIF", **options)
    return stream.getvalue()


def smooth(height=48, width=64):
    y, x = np.mgrid[:height, :width]
    return np.stack([3 * x, 4 * y, x + y], -1).astype(np.uint8)


@pytest.mark.parametrize("bits", [10, 12])
def test_ten_and_twelve_bits_survive(bits):
    rng = np.random.default_rng(0)
    codes = rng.integers(0, 1 << bits, (40, 50, 3)).astype(np.uint16)
    codes[0, 0], codes[0, 1] = 0, (1 << bits) - 1
    picture = decode_avif(deep(codes, bits))
    assert (picture.encoding.depth, picture.encoding.bits) == (16, bits)
    assert picture.codes.dtype == np.uint16
    assert picture.codes.max() == 65535
    written = encode_avif(picture)
    again = cv2.imdecode(np.frombuffer(written, np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(again[..., ::-1], codes)
    with Image.open(io.BytesIO(written)) as image:
        assert np.abs(np.asarray(image) - (codes >> (bits - 8)).astype(int)).max() <= 1


def test_eight_bits_are_written_with_high_quality():
    for number, subsampling in enumerate(("4:4:4", "4:2:2", "4:2:0")):
        data = by_pillow(Image.fromarray(smooth()), quality=95, subsampling=subsampling)
        picture = decode_avif(data)
        assert picture.encoding == Encoding("AVIF", subsampling=number)
        assert decode_avif(encode_avif(picture)).encoding == picture.encoding
    again = decode_avif(encode_avif(picture))
    assert np.abs(again.codes.astype(int) - picture.codes).mean() < 1


@pytest.mark.parametrize("mode", ["L", "RGBA"])
def test_grey_and_opacity(mode):
    codes = np.random.default_rng(1).integers(0, 256, (40, 50, 4)).astype(np.uint8)
    image = Image.fromarray(codes[..., 0] if mode == "L" else codes)
    options = {} if mode == "L" else {"subsampling": "4:4:4"}
    picture = decode_avif(by_pillow(image, quality=100, **options))
    if mode == "L":
        assert np.abs(picture.codes.astype(int) - codes[..., 0]).max() <= 1
        assert picture.encoding.grey
    else:
        assert picture.alpha is not None
        assert np.array_equal(picture.alpha, codes[..., 3])
        assert np.abs(picture.codes.astype(int) - codes[..., :3]).max() <= 2
    again = decode_avif(encode_avif(picture))
    assert again.codes.shape == picture.codes.shape
    assert (again.alpha is None) == (picture.alpha is None)


def test_metadata_are_copied_byte_for_byte(make_exif, make_icc, xmp):
    metadata = Metadata(make_exif(), xmp, make_icc(b"curv" + bytes(8)))
    picture = Decoded(smooth(), None, Encoding("AVIF"), metadata)
    assert decode_avif(encode_avif(picture)).metadata == metadata
    with Image.open(io.BytesIO(encode_avif(picture))) as image:
        assert image.info["icc_profile"] == metadata.icc
        assert image.getexif().get_ifd(0x8769)[0x927C] == b"maker\0note\1\2\3"


def test_the_file_decides_the_orientation_not_its_exif(make_exif):
    data = by_pillow(Image.fromarray(smooth()), exif=make_exif(orientation=6), quality=90)
    assert b"irot" in data
    picture = decode_avif(data)
    assert picture.codes.shape == (64, 48, 3)
    assert picture.metadata.orientation == 1
    # EXIF alone does not turn an AVIF: its pixels count as upright
    metadata = Metadata(make_exif(orientation=6))
    picture = decode_avif(encode_avif(Decoded(smooth(), None, Encoding("AVIF"), metadata)))
    assert picture.codes.shape in {(48, 64, 3), (64, 48, 3)}
    assert picture.metadata.orientation == 1


@pytest.mark.parametrize(("primaries", "transfer"), [(12, 13), (9, 13), (1, 8)])
def test_code_numbers_of_colours_become_a_profile(primaries, transfer):
    data = by_pillow(Image.fromarray(smooth()), icc_profile=b"")
    at = data.index(b"nclx") + 4
    numbered = data[:at] + struct.pack(">HH", primaries, transfer) + data[at + 4 :]
    assert decode_avif(data).metadata.icc == b""
    icc = decode_avif(numbered).metadata.icc
    assert f"Primaries {primaries}".encode("utf-16-be") in icc
    for curve, name in ((16, "PQ"), (18, "HLG")):
        hdr = data[:at] + struct.pack(">HH", 9, curve) + data[at + 4 :]
        with pytest.raises(PhotoError, match=f"HDR picture .{name}"):
            decode_avif(hdr)


@pytest.mark.parametrize("keep", [0.05, 0.3, 0.7, 0.98])
def test_files_cut_short_are_refused(keep):
    data = by_pillow(Image.fromarray(smooth()), quality=95)
    with pytest.raises(PhotoError, match="damaged"):
        decode_avif(data[: int(keep * len(data))])


def test_moving_pictures_are_refused():
    frames = [Image.fromarray(smooth()), Image.fromarray(255 - smooth())]
    data = by_pillow(frames[0], save_all=True, append_images=frames[1:])
    with pytest.raises(PhotoError, match="animated"):
        decode_avif(data)


def test_metadata_behind_the_picture_are_read(make_exif):
    codes = np.random.default_rng(0).integers(0, 256, (96, 96, 3)).astype(np.uint8)
    data = by_pillow(Image.fromarray(codes), quality=95, exif=make_exif())
    [item] = metadata_items(data)
    place = struct.pack(">I", data.index(item.content))
    assert data.count(place) == 1
    behind = data.replace(place, struct.pack(">I", len(data) + 8))
    behind += struct.pack(">I4s", len(item.content) + 8, b"free") + item.content
    assert cv2.imdecode(np.frombuffer(behind, np.uint8), cv2.IMREAD_UNCHANGED) is None
    picture, whole = decode_avif(behind), decode_avif(data)
    assert np.array_equal(picture.codes, whole.codes)
    assert picture.metadata == whole.metadata
    assert picture.metadata.tags().focal_mm == pytest.approx(5.8)


def test_pillow_decodes_grey_with_opacity():
    codes = np.random.default_rng(0).integers(0, 256, (40, 50, 4)).astype(np.uint8)
    codes[..., :3] = codes[..., :1]
    data = by_pillow(Image.fromarray(codes), quality=100, subsampling="4:0:0")
    assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) is None
    picture = decode_avif(data)
    assert picture.encoding.grey
    assert np.abs(picture.codes.astype(int) - codes[..., 0]).max() <= 2
    assert np.array_equal(picture.alpha, codes[..., 3])
    again = decode_avif(encode_avif(picture))
    assert np.array_equal(again.alpha, codes[..., 3])


@pytest.mark.parametrize(("width", "height", "refused"), [(32767, 255, True), (1000, 900, False)])
def test_a_size_that_the_data_cannot_hold_is_refused(width, height, refused):
    codes = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(codes).save(stream, "AVIF", quality=60)
    data = bytearray(stream.getvalue())
    at = data.index(b"ispe") + 8
    data[at : at + 8] = struct.pack(">II", width, height)
    assert len(data) < 4000
    if refused:
        with pytest.raises(PhotoError, match=r"32767 x 255 pixels in .* bytes"):
            decode_avif(bytes(data))
    else:
        assert decode_avif(bytes(data)).codes.shape == (height, width, 3)
