from __future__ import annotations

import pytest

from deshake.metadata.image_resources import with_iptc
from deshake.metadata.png_texts import RAW_PROFILE, profile_text, raw_profile

IPTC = b"\x1c\x02\x05\0\x05Title"
RESOURCES = with_iptc(b"", IPTC)


def text(data: bytes, length: int | None = None) -> bytes:
    return (
        b"\ngeneric profile\n"
        if length is None
        else b"\nx\n%8d\n%s\n" % (length, data.hex().encode())
    )


@pytest.mark.parametrize(
    ("kind", "data", "expected"),
    [
        (b"exif", b"Exif\0\0II*\0", {"exif": b"II*\0"}),
        (b"APP1", b"Exif\0\0MM\0*", {"exif": b"MM\0*"}),
        (b"APP1", b"http://ns.adobe.com/xap/1.0/\0<x/>", {"xmp": b"<x/>"}),
        (b"xmp", b"<x/>", {"xmp": b"<x/>"}),
        (b"icm", b"profile", {"icc": b"profile"}),
        (b"iptc", RESOURCES, {"iptc": IPTC, "resources": RESOURCES}),
        (b"8bim", RESOURCES, {"iptc": IPTC, "resources": RESOURCES}),
        (b"iptc", IPTC, {"iptc": IPTC}),
        (b"exif", b"rubbish", {}),
        (b"something", b"else", {}),
    ],
)
def test_profiles_of_every_name(kind: bytes, data: bytes, expected: dict[str, bytes]) -> None:
    assert raw_profile(RAW_PROFILE + kind + b"\0\0rest", text(data, len(data))) == expected


@pytest.mark.parametrize(
    "broken", [b"", b"\niptc\n", b"\niptc\n 7\n0011", b"\niptc\n x\n00", text(b"")]
)
def test_damaged_texts_give_nothing(broken: bytes) -> None:
    assert raw_profile(RAW_PROFILE + b"iptc", broken) == {}


def test_a_profile_survives_writing_and_reading() -> None:
    data = with_iptc(b"", IPTC * 40)
    assert raw_profile(RAW_PROFILE + b"iptc\0", profile_text(data))["resources"] == data
