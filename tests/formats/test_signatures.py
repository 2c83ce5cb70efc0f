from __future__ import annotations

import io
import struct

import numpy as np
import pytest
import tifffile
from PIL import Image

from deshake.errors import PhotoError
from deshake.formats.signatures import photo_format


def saved(form):
    stream = io.BytesIO()
    Image.new("RGB", (40, 40)).save(stream, form)
    return stream.getvalue()


def brands(*names):
    return struct.pack(">I4s4sI", 16 + 4 * len(names), b"ftyp", names[0], 0) + b"".join(names[1:])


@pytest.mark.parametrize("form", ["JPEG", "PNG", "TIFF", "WEBP", "AVIF", "JPEG2000"])
@pytest.mark.parametrize("suffix", ["", ".jpg", ".xyz"])
def test_pictures_of_every_format(form, suffix):
    assert photo_format(saved(form), suffix) == form


def test_directories_or_the_name_identify_a_raw_file(make_dng):
    dng = make_dng(np.zeros((20, 20, 3)))
    assert photo_format(dng, ".tif") == "RAW"
    tiff = saved("TIFF")
    assert photo_format(tiff, ".NEF") == "RAW"
    assert photo_format(tiff, ".tiff") == "TIFF"
    stream = (
        io.BytesIO()
    )  # a preview, and the sensor's data in a directory below it, as in Nikon's and Sony's files
    with tifffile.TiffWriter(stream) as writer:
        writer.write(np.zeros((8, 8, 3), np.uint8), subifds=1, metadata=None)
        writer.write(np.zeros((16, 16), np.uint16), photometric="cfa", metadata=None)
    assert photo_format(stream.getvalue()) == "RAW"
    assert photo_format(b"II*\0\x10\0\0\0CR\2\0" + bytes(40)) == "RAW"
    for mark in (b"FUJIFILMCCD-RAW 0201", b"IIRO\x08\0", b"IIU\0\x18\0", b"FOVb", b"\0MRM"):
        assert photo_format(mark + bytes(40), ".jpg") == "RAW"


def test_brands_identify_files_of_boxes():
    assert photo_format(brands(b"heic", b"mif1", b"heic")) == "HEIF"
    assert photo_format(brands(b"mif1", b"heic")) == "HEIF"
    assert photo_format(brands(b"mif1", b"avif", b"miaf")) == "AVIF"
    assert photo_format(brands(b"crx ", b"isom")) == "RAW"
    with pytest.raises(PhotoError, match="video"):
        photo_format(brands(b"isom", b"mp42"))
    with pytest.raises(PhotoError, match="sequence"):
        photo_format(brands(b"avis", b"avif"))


@pytest.mark.parametrize(
    ("data", "what"),
    [(b"", "empty"), (b"GIF89a", "GIF"), (b"BM1234567890", "known format"), (b"a", "known format")],
)
def test_other_files_are_refused(data, what):
    with pytest.raises(PhotoError, match=what):
        photo_format(data)


def test_pieces_of_a_tiff_raise_no_other_error(make_dng):
    data = make_dng(np.zeros((20, 20, 3)))
    refused, forms = [], set()
    for length in range(0, 400, 13):
        try:
            forms.add(photo_format(data[:length]))
        except PhotoError:
            refused.append(length)
    assert forms <= {"RAW", "TIFF"}
    assert refused == [0]


def test_a_name_alone_can_identify_a_raw_file():
    data = b"nii\x86ghf\x84eqe\x88ilk\x86" * 100  # the beginning of a Kodak C330's file: pixels
    assert photo_format(data, ".KDC") == "RAW"
    with pytest.raises(PhotoError, match="known format"):
        photo_format(data, ".jpg")
