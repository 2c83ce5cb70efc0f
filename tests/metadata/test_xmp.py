from __future__ import annotations

import time
from xml.etree import ElementTree as ET

import pytest

from deshake.metadata import xmp

RDF = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}"
OURS = ("own", "urn:own#")
PACKET = (
    b'<?xpacket begin="\xef\xbb\xbf" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/">'
    b'<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
    b'<rdf:Description rdf:about="" xmlns:tiff="http://ns.adobe.com/tiff/1.0/"'
    b' tiff:Orientation="6"/>\n</rdf:RDF></x:xmpmeta>\n' + 40 * b" " + b'\n<?xpacket end="w"?>'
)
TEXT = 'a < b & "c" > d\'s \u00e9 ]]>'


def value(packet: bytes) -> str | None:
    return ET.fromstring(packet).findtext(f".//{RDF}Description/{{urn:own#}}P")  # noqa: S314


@pytest.mark.parametrize("text", [TEXT, "", "{}"])
def test_a_parser_of_xml_reads_an_inserted_property(text: str) -> None:
    for packet in (PACKET, b""):
        more = xmp.insert(packet, OURS, "P", text)
        assert (value(more) or "") == text
        assert xmp.property_of(b"before" + more + b"after", "own", "P") == text


def test_nothing_else_in_the_packet_changes() -> None:
    more = xmp.insert(PACKET, OURS, "P", TEXT)
    assert len(more) > len(PACKET)
    assert xmp.without(more, "own", "P") == PACKET


def test_the_subject_is_that_of_the_packet() -> None:
    named = PACKET.replace(b'rdf:about=""', b"rdf:about='uuid:7'")
    root = ET.fromstring(xmp.insert(named, OURS, "P", "x"))  # noqa: S314
    assert {item.get(f"{RDF}about") for item in root.iter(f"{RDF}Description")} == {"uuid:7"}


def test_an_empty_rdf_is_opened() -> None:
    packet = b'<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"/>'
    assert value(b"<x>" + xmp.insert(packet, OURS, "P", "x") + b"</x>") == "x"


@pytest.mark.parametrize(
    "packet", [b"rubbish", b"<x:xmpmeta/>", PACKET.decode().encode("utf-16"), b"\0"]
)
def test_bytes_that_are_no_packet_take_no_property(packet: bytes) -> None:
    assert xmp.insert(packet, OURS, "P", "x") is None


@pytest.mark.parametrize(
    "packet",
    [
        b"<rdf:Description own:P='x' own:Q=\"y\"/>",
        b'<rdf:Description own:P="x" own:Q="y"/>',
        b'<rdf:Description own:Q="y"><own:P>x</own:P></rdf:Description>',
        b'<rdf:Description own:Q="y"><own:P xml:lang="en">x</own:P ></rdf:Description>',
    ],
)
def test_a_property_of_any_form_is_removed(packet: bytes) -> None:
    rest = xmp.without(packet, "own", "P")
    assert b"own:P" not in rest
    assert b'own:Q="y"' in rest


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (b"<own:P>a&lt;b&amp;lt;</own:P>", "a<b&lt;"),
        (b'own:P="{&quot;a&#34;}"', '{"a"}'),
        (b"own:P='it&apos;s'", "it's"),
        (b"own:P=", None),
        (b"", None),
    ],
)
def test_properties_of_other_writers_are_read(text: bytes, expected: str | None) -> None:
    assert xmp.property_of(text, "own", "P") == expected


def test_upright_and_padding() -> None:
    assert xmp.upright(PACKET) == PACKET.replace(b'Orientation="6"', b'Orientation="1"')
    element = b"<tiff:Orientation>8</tiff:Orientation>"
    assert xmp.upright(element) == element.replace(b"8", b"1")
    bare = xmp.without_padding(PACKET)
    assert bare == PACKET.replace(40 * b" " + b"\n", b"")
    assert xmp.without_padding(b"no packet  ") == b"no packet  "


@pytest.mark.parametrize(
    "part",
    [b"<rdf:Description ", b'own:P="', b"<own:P>", b"<own:P ", b" ", b'rdf:about="', b"<rdf:RDF "],
)
def test_hostile_packets_take_no_long_time(part: bytes) -> None:
    packet = b"own:P " + part * (2_000_000 // len(part))
    start = time.process_time()
    xmp.without(packet, "own", "P")
    xmp.insert(packet, OURS, "P", "x")
    xmp.property_of(packet, "own", "P")
    xmp.without_padding(packet)
    assert time.process_time() - start < 5


@pytest.mark.parametrize(
    ("text", "small"),
    [
        (b'exif:FocalPlaneXResolution="80/1"', b'exif:FocalPlaneXResolution="40000/1000"'),
        (b"exif:FocalPlaneYResolution='81'", b"exif:FocalPlaneYResolution='20250/1000'"),
        (b"<exif:FocalPlaneXResolution>9/2</exif", b"<exif:FocalPlaneXResolution>2250/1000</exif"),
        (b'exif:FocalPlaneXResolution="80/0"', b'exif:FocalPlaneXResolution="80/0"'),
        (b'exif:FocalPlaneXResolution="many"', b'exif:FocalPlaneXResolution="many"'),
        (b'exif:FocalPlaneResolutionUnit="2"', b'exif:FocalPlaneResolutionUnit="2"'),
    ],
)
def test_the_resolution_of_the_focal_plane_is_reduced(text: bytes, small: bytes) -> None:
    assert xmp.scaled(text, 0.5, 0.25) == small
