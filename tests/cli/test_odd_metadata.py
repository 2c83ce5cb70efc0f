"""Metadata that other programs trip over: they survive, or one line reports what is lost."""

from __future__ import annotations

import io
import re
import struct
import zlib

import pytest
from PIL import Image, ImageCms
from support.crafted_photos import HEIGHT, ICC, WIDTH, codes, photo

from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.metadata.provenance import read_provenance

P3 = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
LONG = 80_000


@pytest.fixture
def deblurred(deshake, tmp_path):
    """Deblur a photo by a kernel that does nothing; return the messages and the result."""
    still = RotationKernel.from_path([(0, 0, 0)], Camera.from_focal(40, HEIGHT, WIDTH))
    write_kernel(tmp_path / "still.npz", KernelFile(still))

    def run(name, data, ending, *, kept=True):
        path, out = tmp_path / name, tmp_path / f"out.{ending}"
        path.write_bytes(data)
        outcome = deshake("deblur", path, tmp_path / "still.npz", "-o", out)
        assert outcome.code == 0
        assert (read_provenance(out) is not None) == kept
        lines = outcome.err.splitlines()
        assert all(line.startswith(f"warning: {path}: ") for line in lines)
        return [line.removeprefix(f"warning: {path}: ") for line in lines], out

    return run


def plain(form="PNG", **options):
    stream = io.BytesIO()
    ramps = codes(8, 3).swapaxes(0, 1).copy()
    Image.fromarray(ramps).save(stream, form, **options)
    return stream.getvalue()


def chunk(name, content):
    check = struct.pack(">I", zlib.crc32(name + content))
    return struct.pack(">I", len(content)) + name + content + check


def in_png(*chunks):
    data = plain()
    return data[:33] + b"".join(chunks) + data[33:]


def in_jpeg(*segments):
    data = plain("JPEG")
    parts = [
        bytes([0xFF, mark]) + struct.pack(">H", len(part) + 2) + part for mark, part in segments
    ]
    return data[:2] + b"".join(parts) + data[2:]


def long_exif():
    exif = Image.Exif()
    exif[271] = "Acme"
    exif._ifds[0x8769] = {0x920A: 5.8, 0x9286: b"c" * LONG}
    return exif.tobytes().removeprefix(b"Exif\0\0")


@pytest.mark.parametrize("source", ["png", "tif", "webp"])
def test_exif_longer_than_a_jpeg_holds(deblurred, source):
    form = {"png": "PNG", "tif": "TIFF", "webp": "WEBP"}[source]
    said, out = deblurred(f"a.{source}", plain(form, exif=long_exif()), "jpg")
    [loss] = [line for line in said if "EXIF" in line]
    assert loss == "its EXIF is too long for a JPEG: tags 0x9286 are left out"
    with Image.open(out) as picture:
        assert picture.getexif()[271] == "Acme"
        assert picture.getexif().get_ifd(0x8769)[0x920A] == pytest.approx(5.8)
    said, out = deblurred(f"b.{source}", plain(form, exif=long_exif()), "tif")
    assert not said
    with Image.open(out) as picture:
        assert len(picture.getexif().get_ifd(0x8769)[0x9286]) == LONG


def test_exif_of_a_full_segment_stays_as_it_is(deblurred):
    block = photo("JPEG", 8, 3, ("EXIF",), 1)
    block = block[block.index(b"Exif\0\0") + 6 :][:300].ljust(65_527, b"\0")
    said, out = deblurred("a.jpg", in_jpeg((0xE1, b"Exif\0\0" + block)), "jpg")
    assert not said
    with Image.open(out) as picture:
        assert len(picture.info["exif"]) == 6 + 65_527


def test_xmp_longer_than_a_jpeg_holds(deblurred):
    text = "x" * LONG
    packet = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
        'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
        f'xmlns:p="urn:p#" p:Long="{text}"/></rdf:RDF></x:xmpmeta>'
    )
    data = in_png(chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + packet.encode()))
    said, out = deblurred("a.png", data, "jpg")
    assert not said
    with Image.open(out) as picture:
        parts = [part for name, part in picture.applist if name == "APP1"]
        guid = re.search(r"HasExtendedXMP>(\w{32})<", picture.info["xmp"].decode())[1].encode()
    extended = [part[75:] for part in parts if part[35:67] == guid]
    assert len(extended) == 2
    assert text.encode() in b"".join(extended)
    said, again = deblurred("b.jpg", out.read_bytes(), "webp")
    assert not said
    with Image.open(again) as picture:
        assert text.encode() in picture.info["xmp"]
        assert b"HasExtendedXMP" not in picture.info["xmp"]


def test_of_two_profiles_the_first_is_kept(deblurred):
    profiles = [chunk(b"iCCP", b"x\0\0" + zlib.compress(item)) for item in (ICC, P3)]
    segments = [(0xE2, b"ICC_PROFILE\0\1\1" + item) for item in (ICC, P3)]
    for name, data in (("a.png", in_png(*profiles)), ("a.jpg", in_jpeg(*segments))):
        said, out = deblurred(name, data, "tif")
        assert not said
        with Image.open(out) as picture:
            assert picture.info["icc_profile"] == ICC
        out.unlink()


@pytest.mark.parametrize(
    ("name", "data", "ending"),
    [
        ("a.jpg", in_jpeg((0xFE, b"a comment")), "png"),
        ("a.png", in_png(chunk(b"tEXt", b"Title\0A title")), "jpg"),
    ],
)
def test_texts_that_are_lost_are_reported(deblurred, name, data, ending):
    said, _ = deblurred(name, data, ending)
    assert ["texts" in line for line in said] == [True]
    said, out = deblurred(f"again-{name}", data, name[2:])
    assert not said
    assert any(text in out.read_bytes() for text in (b"a comment", b"A title"))


def test_xmp_that_is_none_stays_and_takes_no_provenance(deblurred):
    packet = b"<rubbish/>"
    data = in_jpeg((0xE1, b"http://ns.adobe.com/xap/1.0/\0" + packet))
    said, out = deblurred("a.jpg", data, "png", kept=False)
    assert said == ["its XMP metadata are damaged: they do not get a note of how it was made"]
    with Image.open(out) as picture:
        assert picture.info["xmp"] == packet


def test_a_maker_note_deep_in_a_tiff_is_moved_and_that_is_reported(deblurred):
    data = bytearray(photo("TIFF", 8, 3, ("maker note",), 6))
    at = data.index(b"NOTE")
    note = data[at : at + 40]
    place = data.index(struct.pack("<I", at))
    data += bytes(70_000 - len(data)) + note
    struct.pack_into("<I", data, place, 70_000)
    said, out = deblurred("a.tif", bytes(data), "png")
    assert said == ["its maker note has moved: some programs may not read all of it"]
    with Image.open(out) as picture:
        assert bytes(picture.getexif().get_ifd(0x8769)[0x927C]).startswith(b"NOTE")
