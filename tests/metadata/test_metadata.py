from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest

from deshake.metadata.camera_tags import CameraTags
from deshake.metadata.metadata import Metadata

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.mark.parametrize("order", ["<", ">"])
def test_tags_of_a_camera(make_exif: Callable[..., bytes], order: str) -> None:
    below = {0xA405: 35, 0xA20E: 11520.0, 0xA210: 2, 0xA002: 2592, 0xA003: 1944, 0x8827: 80}
    tags = Metadata(exif=make_exif(order, below=below)).tags()
    assert tags.focal_plane_px_per_mm == pytest.approx(11520 / 25.4)
    assert tags == CameraTags(
        make="Canon",
        model="Canon DIGITAL IXUS 70",
        focal_mm=5.8,
        focal_35mm=35,
        focal_plane_px_per_mm=tags.focal_plane_px_per_mm,
        pixel_size=(2592, 1944),
        exposure_s=0.5,
        iso=80,
    )


@pytest.mark.parametrize(("unit", "per_mm"), [(2, 254 / 25.4), (3, 25.4), (4, 254), (5, 254_000)])
def test_units_of_the_focal_plane(
    make_exif: Callable[..., bytes], unit: int, per_mm: float
) -> None:
    tags = Metadata(exif=make_exif(below={0xA20F: 254.0, 0xA210: unit})).tags()
    assert tags.focal_plane_px_per_mm == pytest.approx(per_mm)


def test_an_unknown_unit_gives_no_density(make_exif: Callable[..., bytes]) -> None:
    tags = Metadata(exif=make_exif(below={0xA20E: 254.0, 0xA210: 1})).tags()
    assert tags.focal_plane_px_per_mm is None


def entry(tag: int, kind: int, raw: bytes) -> bytes:
    """Make a block whose EXIF directory holds one tag."""
    sizes = {2: 1, 3: 2, 5: 8, 7: 1, 10: 8, 11: 4, 12: 8}
    head = b"II*\0" + struct.pack("<IHHHIII", 8, 1, 34665, 4, 1, 26, 0)
    count = len(raw) // sizes[kind]
    place = raw.ljust(4, b"\0") if len(raw) <= 4 else struct.pack("<I", 44)
    return head + struct.pack("<HHHI", 1, tag, kind, count) + place + bytes(4) + raw


@pytest.mark.parametrize(
    ("kind", "raw", "expected"),
    [
        (5, struct.pack("<II", 58, 10), 5.8),
        (10, struct.pack("<ii", 58, 10), 5.8),
        (11, struct.pack("<f", 5.5), 5.5),
        (12, struct.pack("<d", 5.5), 5.5),
        (3, struct.pack("<H", 6), 6),
        (5, struct.pack("<II", 0, 0), None),
        (5, struct.pack("<II", 7, 0), None),
        (5, struct.pack("<II", 0, 7), None),
        (10, struct.pack("<ii", -58, 10), None),
        (12, struct.pack("<d", float("inf")), None),
        (2, b"5.8\0", None),
        (7, b"\1\2\3\4", None),
        (5, b"", None),
    ],
)
def test_odd_values_read_as_none(kind: int, raw: bytes, expected: float | None) -> None:
    tags = Metadata(exif=entry(0x920A, kind, raw)).tags()
    assert tags.focal_mm == (expected if expected is None else pytest.approx(expected))


def test_without_metadata_all_tags_are_empty() -> None:
    assert Metadata().tags() == CameraTags()
    assert Metadata(exif=b"rubbish").tags() == CameraTags()
    assert Metadata().orientation == 1


def test_upright_sets_the_orientation_in_xmp_too(
    make_exif: Callable[..., bytes], xmp: bytes
) -> None:
    turned = Metadata(make_exif(orientation=6), xmp, b"icc").upright()
    assert turned.orientation == 1
    assert turned.xmp == xmp.replace(b'Orientation="6"', b'Orientation="1"')
    assert turned.icc == b"icc"
    same = Metadata(make_exif(orientation=1), xmp, b"icc")
    assert same.upright() is same
