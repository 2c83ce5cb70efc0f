from __future__ import annotations

import io
import struct

from PIL import Image, IptcImagePlugin

from deshake.metadata.image_resources import iptc_of, with_iptc, without_padding, without_thumbnails

IPTC = b"\x1c\x02\x05\0\x05Title\x1c\x02\x19\0\x04word"


def resource(kind: int, content: bytes, name: bytes = b"") -> bytes:
    label = bytes([len(name)]) + name
    padding = bytes(len(content) % 2)
    return (
        b"8BIM"
        + struct.pack(">H", kind)
        + label
        + bytes(len(label) % 2)
        + struct.pack(">I", len(content))
        + content
        + padding
    )


RESOURCES = (
    resource(0x03ED, b"resolution", b"odd")
    + resource(0x0409, b"old thumbnail")
    + resource(0x0404, IPTC)
    + resource(0x040C, b"thumbnail", b"even")
    + resource(0x0425, b"digest")
)


def test_iptc_is_read_from_the_resources() -> None:
    assert iptc_of(RESOURCES) == IPTC
    assert iptc_of(resource(1, b"x")) == b""
    assert iptc_of(b"") == b""


def test_thumbnails_are_removed_and_all_else_is_kept() -> None:
    assert without_thumbnails(RESOURCES) == (
        resource(0x03ED, b"resolution", b"odd")
        + resource(0x0404, IPTC)
        + resource(0x0425, b"digest")
    )


def test_the_same_iptc_changes_nothing() -> None:
    assert with_iptc(RESOURCES, IPTC) is RESOURCES
    other = with_iptc(RESOURCES, b"\x1c\x02\x05\0\x01X")
    assert iptc_of(other) == b"\x1c\x02\x05\0\x01X"
    assert b"Title" not in other
    assert other.endswith(resource(0x0425, b"digest"))


def test_another_reader_reads_the_iptc() -> None:
    stream = io.BytesIO()
    segment = b"Photoshop 3.0\0" + with_iptc(b"", IPTC)
    extra = b"\xff\xed" + struct.pack(">H", len(segment) + 2) + segment
    Image.new("L", (8, 8)).save(stream, "JPEG", extra=extra)
    with Image.open(stream) as picture:
        assert IptcImagePlugin.getiptcinfo(picture) == {(2, 5): b"Title", (2, 25): b"word"}


def test_resources_cut_short_are_unchanged() -> None:
    cuts = [RESOURCES[:size] for size in range(len(RESOURCES))]
    assert [cut for cut in cuts if not set(without_thumbnails(cut)) <= set(cut)] == []
    assert [cut for cut in cuts if iptc_of(with_iptc(cut, IPTC)) != IPTC] == []


def test_rubbish_stays() -> None:
    assert without_thumbnails(b"rubbish") == b"rubbish"


def test_only_the_padding_is_removed() -> None:
    for count in range(4):
        assert without_padding(IPTC + bytes(count)) == IPTC
    long = b"\x1c\x02\x05\x80\x04\0\0\0\1x\0"  # a size of more than two bytes
    for odd in (b"", b"\0" * 9, IPTC + b"more", IPTC + bytes(9), IPTC[:-2], long):
        assert without_padding(odd) == odd
