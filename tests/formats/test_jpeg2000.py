from __future__ import annotations

import io
import struct

import cv2
import numpy as np
import pytest
from PIL import Image

from deshake.errors import PhotoError
from deshake.formats.boxes import read_boxes
from deshake.formats.encoding import Decoded, Encoding
from deshake.formats.jpeg2000 import decode_jpeg2000, encode_jpeg2000
from deshake.metadata.metadata import Metadata

XMP_BOX = bytes.fromhex("be7acfcb97a942e89c71999491e3afac")


def by_pillow(codes, **options):
    stream = io.BytesIO()
    Image.fromarray(codes).save(stream, "JPEG2000", **options)
    return stream.getvalue()


@pytest.mark.parametrize("kind", [(c, d) for c in (1, 3, 4) for d in (8, 16)], ids=str)
def test_all_codes_survive(make_codes, kind):
    channels, depth = kind
    codes = make_codes(40, 50, channels, depth)
    colours = codes if channels == 1 else codes[..., :3]
    alpha = codes[..., 3] if channels == 4 else None
    encoding = Encoding("JPEG2000", depth=depth, grey=channels == 1)
    data = encode_jpeg2000(Decoded(colours, alpha, encoding, Metadata()))
    picture = decode_jpeg2000(data)
    assert picture.encoding == encoding
    assert np.array_equal(picture.codes, colours)
    assert alpha is None or np.array_equal(picture.alpha, alpha)
    if depth == 8:
        with Image.open(io.BytesIO(data)) as image:
            assert np.array_equal(np.asarray(image), codes)


def test_files_of_other_writers_and_bare_streams_are_read(make_codes):
    codes = make_codes(40, 50, 3)
    for options in ({}, {"no_jp2": True}):
        picture = decode_jpeg2000(by_pillow(codes, **options))
        assert np.array_equal(picture.codes, codes)
    twelve = (make_codes(40, 50, 3, 16) >> 4).astype(np.uint16)
    data = cv2.imencode(".jp2", twelve, [cv2.IMWRITE_JPEG2000_COMPRESSION_X1000, 1000])[1]
    at = data.tobytes().index(b"\xff\x4f\xff\x51") + 42
    twelve_bits = bytearray(data.tobytes())
    for index in range(3):
        assert twelve_bits[at + 3 * index] == 15
    assert decode_jpeg2000(bytes(twelve_bits)).encoding.depth == 16


def test_metadata_are_copied_byte_for_byte(make_codes, make_exif, make_icc, xmp):
    metadata = Metadata(make_exif(), xmp, make_icc(b"curv" + bytes(8)))
    extra = struct.pack(">I4s", 12, b"xml ") + b"<a/>"
    encoding = Encoding("JPEG2000", carried=extra)
    data = encode_jpeg2000(Decoded(make_codes(40, 50, 3), None, encoding, metadata))
    picture = decode_jpeg2000(data)
    assert picture.metadata == metadata
    assert picture.encoding.carried == extra
    assert data.count(XMP_BOX + xmp) == 1
    assert data.count(b"JpgTiffExif->JP2" + metadata.exif) == 1
    names = [name for name, _, _ in read_boxes(data)]
    assert names == [b"jP  ", b"ftyp", b"jp2h", b"xml ", b"uuid", b"uuid", b"jp2c"]


def test_only_grey_and_rgb(make_codes):
    data = by_pillow(make_codes(40, 50, 3))
    at = data.index(b"colr") + 7
    cmyk = data[:at] + struct.pack(">I", 12) + data[at + 4 :]
    with pytest.raises(PhotoError, match="neither grey nor RGB"):
        decode_jpeg2000(cmyk)
    with pytest.raises(PhotoError, match="unusual kind"):
        decode_jpeg2000(by_pillow(make_codes(40, 50, 2)))


@pytest.mark.parametrize("keep", [0.01, 0.1, 0.5, 0.9, 0.999])
def test_files_cut_short_are_refused(make_codes, keep):
    data = by_pillow(make_codes(40, 50, 3))
    with pytest.raises(PhotoError, match="damaged"):
        decode_jpeg2000(data[: int(keep * len(data))])


def test_bombs_are_refused_before_they_are_decoded(make_codes):
    data = bytearray(by_pillow(make_codes(40, 50, 3), no_jp2=True))
    struct.pack_into(">II", data, 8, 100_000, 100_000)
    with pytest.raises(PhotoError, match="million allowed"):
        decode_jpeg2000(bytes(data))


def test_pictures_too_small_for_it_are_refused(make_codes):
    picture = Decoded(make_codes(20, 50, 3), None, Encoding("JPEG2000"), Metadata())
    with pytest.raises(PhotoError, match="at least 32 pixels"):
        encode_jpeg2000(picture)
