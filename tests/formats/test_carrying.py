from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from deshake.formats.carrying import LONGEST_XMP, carried
from deshake.metadata import exif, xmp
from deshake.metadata.density import Density
from deshake.metadata.image_resources import with_iptc
from deshake.metadata.metadata import Metadata
from deshake.metadata.provenance import NAMESPACE, PROPERTY, with_provenance

if TYPE_CHECKING:
    from collections.abc import Callable

IPTC = b"\x1c\x02\x05\0\x05Title"
FORMATS = ("JPEG", "PNG", "TIFF", "WEBP")
PROVENANCE = {"deshake": "1.2.3"}


def packet(text: str = "x", *, padding: int = 0) -> bytes:
    made = xmp.insert(b"", ("dc", "http://purl.org/dc/elements/1.1/"), "format", text)
    return made.replace(b"<?xpacket end", b" " * padding + b"\n<?xpacket end")


@pytest.mark.parametrize("form", FORMATS)
def test_metadata_that_fit_are_copied_byte_for_byte(
    make_exif: Callable[..., bytes], form: str
) -> None:
    metadata = Metadata(make_exif(), packet(padding=99), b"icc")
    fitted = carried(metadata, form, 7, 8)
    assert fitted.metadata == metadata
    assert fitted.losses == ()


@pytest.mark.parametrize("form", FORMATS)
def test_iptc_is_kept_in_formats_that_hold_it(form: str) -> None:
    fitted = carried(Metadata(iptc=IPTC, resources=with_iptc(b"", IPTC)), form, 7, 8)
    if form == "WEBP":
        assert fitted.metadata == Metadata()
        assert fitted.losses == ("WebP has no place for IPTC, which is left out",)
    else:
        assert fitted.metadata.iptc == IPTC
        assert not fitted.losses


def test_sizes_and_thumbnails_are_renewed() -> None:
    text = packet().replace(
        b"<dc:format>x",
        b'<q tiff:ImageWidth="9"/><exif:PixelYDimension>9</exif:PixelYDimension>'
        b"<xmp:Thumbnails><rdf:Alt>/9j/</rdf:Alt></xmp:Thumbnails><dc:format>x",
    )
    fitted = carried(Metadata(xmp=text), "PNG", 70, 80).metadata.xmp
    assert b'ImageWidth="80"' in fitted
    assert b"<exif:PixelYDimension>70<" in fitted
    assert b"humbnails" not in fitted
    assert b"<dc:format>x" in fitted


def test_exif_too_long_for_a_jpeg_is_shortened_and_reported(
    make_exif: Callable[..., bytes],
) -> None:
    metadata = Metadata(make_exif(below={0x9286: b"c" * 70_000}))
    fitted = carried(metadata, "JPEG", 7, 8)
    assert len(fitted.metadata.exif) <= exif.LONGEST
    assert fitted.metadata.tags().focal_mm == pytest.approx(5.8)
    assert "tags 0x9286 are left out" in fitted.losses[-1]
    assert carried(metadata, "TIFF", 7, 8).metadata.exif == metadata.exif


def test_a_long_packet_loses_its_padding_first() -> None:
    long = packet("x" * 60_000, padding=9000)
    fitted = carried(Metadata(xmp=long), "JPEG", 7, 8)
    assert fitted.metadata.xmp == xmp.without_padding(long)
    assert not fitted.losses


def test_a_longer_packet_is_split_and_joined_again() -> None:
    long = packet("x" * 100_000)
    metadata = with_provenance(Metadata(xmp=long), PROVENANCE)
    fitted = carried(metadata, "JPEG", 7, 8)
    short, more = fitted.metadata.xmp, fitted.metadata.extended_xmp
    assert not fitted.losses
    assert len(short) <= LONGEST_XMP
    assert b"x" * 100_000 in more
    assert xmp.guid(short, b"").decode() == xmp.property_of(short, "xmpNote", "HasExtendedXMP")
    assert xmp.property_of(short, NAMESPACE[0], PROPERTY) == '{"deshake": "1.2.3"}'
    assert xmp.property_of(more, NAMESPACE[0], PROPERTY) is None
    again = carried(fitted.metadata, "PNG", 7, 8)
    assert not again.losses
    assert again.metadata.extended_xmp == b""
    assert xmp.property_of(again.metadata.xmp, "dc", "format") == "x" * 100_000
    assert xmp.property_of(again.metadata.xmp, NAMESPACE[0], PROPERTY) == '{"deshake": "1.2.3"}'
    assert b"HasExtendedXMP" not in again.metadata.xmp


def test_a_packet_without_room_takes_no_provenance() -> None:
    full = xmp.without_padding(packet("x" * 65_000))
    metadata = with_provenance(
        Metadata(xmp=full, extended_xmp=b"more"), {"deshake": "1", "a": "b" * 999}
    )
    fitted = carried(metadata, "JPEG", 7, 8)
    assert fitted.metadata.xmp == full
    assert fitted.metadata.extended_xmp == b"more"
    assert fitted.losses == ("its XMP has no room for the provenance",)


@pytest.mark.parametrize(
    "more", [b"rubbish", b"<rdf:RDF><a:b/></rdf:RDF>", b"<rdf:RDF></rdf:RDF>" * 2]
)
def test_damaged_extended_xmp_is_reported(more: bytes) -> None:
    fitted = carried(Metadata(xmp=packet(), extended_xmp=more), "TIFF", 7, 8)
    assert fitted.metadata.xmp == packet()
    assert fitted.losses == ("its extended XMP is damaged, and left out",)


def test_blocks_too_long_for_a_jpeg_are_left_out() -> None:
    fitted = carried(Metadata(xmp=b"x" * 70_000, icc=bytes(17_000_000)), "JPEG", 7, 8)
    assert fitted.metadata == Metadata()
    assert len(fitted.losses) == 2


@pytest.mark.parametrize("density", [None, Density(118, 118, "cm")])
def test_a_new_block_in_a_jpeg_has_all_required_tags(density: Density | None) -> None:
    bare = with_provenance(Metadata(density=density), PROVENANCE)
    block = carried(bare, "JPEG", 30, 40).metadata.exif
    first = exif.read_first(block)
    below = exif.read_below(block, first, exif.EXIF_POINTER)
    assert set(first.values) == {282, 283, 296, 305, 531, exif.EXIF_POINTER}
    assert set(below.values) == {0x9000, 0x9101, 0xA000, 0xA001, 0xA002, 0xA003}
    assert first.numbers(282) == ([72] if density is None else [118])
    assert first.text(305) == "deshake 1.2.3"
    assert (below.numbers(0xA001), below.numbers(0xA002), below.numbers(0xA003)) == (
        [1],
        [40],
        [30],
    )
    known = carried(replace(bare, icc=b"icc"), "JPEG", 30, 40).metadata.exif
    assert exif.read_below(known, exif.read_first(known), exif.EXIF_POINTER).numbers(0xA001) == [
        65535
    ]
    assert carried(bare, "PNG", 30, 40).metadata.exif == bare.exif


def test_the_block_of_a_camera_is_not_completed(make_exif: Callable[..., bytes]) -> None:
    assert carried(Metadata(make_exif()), "JPEG", 7, 8).metadata.exif == make_exif()
