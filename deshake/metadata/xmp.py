"""XMP packets, edited as text: all other bytes stay the same.

An XML library would write a new packet, with other prefixes and without the padding. This module
reads UTF-8 alone, the encoding of XMP in JPEG, PNG, TIFF and WebP.

References
----------
.. [1] Extensible Metadata Platform (XMP) Specification, Part 1 (ISO 16684-1) and Part 3, Adobe.

"""

from __future__ import annotations

import hashlib
import re
from typing import Final
from xml.parsers import expat

__all__ = [
    "extended",
    "guid",
    "insert",
    "merged",
    "property_of",
    "scaled",
    "upright",
    "with_size",
    "without",
    "without_padding",
    "without_thumbnails",
]

_RDF: Final = b"http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_NEW: Final = (
    b'<?xpacket begin="\xef\xbb\xbf" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="%s">\n'
    b'</rdf:RDF></x:xmpmeta>\n<?xpacket end="w"?>' % _RDF
)
_END: Final = b"<?xpacket end"
_ORIENTATION: Final = re.compile(rb"(tiff:Orientation(?:=[\"']|>))[2-8](?=[\"']|</)")
_SIZE: Final = rb"(%s(?:=[\"']|>))\d{1,9}(?=[\"']|</)"
_WIDTH: Final = re.compile(_SIZE % b"(?:tiff:ImageWidth|exif:PixelXDimension)")
_HEIGHT: Final = re.compile(_SIZE % b"(?:tiff:ImageLength|exif:PixelYDimension)")
_RESOLUTION: Final = re.compile(
    rb"(exif:FocalPlane([XY])Resolution(?:=[\"']|>))(\d{1,10})(?:/(\d{1,10}))?(?=[\"']|</)"
)
_FINE: Final = 1000  # the denominator of changed fractions
_NOTE: Final = ("xmpNote", "http://ns.adobe.com/xmp/note/")
_EXTENDED: Final = "HasExtendedXMP"
_ABOUT: Final = re.compile(rb"rdf:about=(\"[^\"<]{0,200}\"|'[^'<]{0,200}')")
_NO_MORE: Final = rb"(?:\s(?:xmlns:\w+|rdf:about)=(?:\"[^\"<]{0,300}\"|'[^'<]{0,300}')){0,4}"
_EMPTY_RDF: Final = re.compile(rb"<rdf:RDF(\s[^<>]{0,2000}?)?/>")


def insert(packet: bytes, namespace: tuple[str, str], name: str, text: str) -> bytes | None:
    """Return a packet with one more property; None if the packet has no place for it.

    Parameters
    ----------
    packet : bytes
        The packet; empty for a new one.
    namespace : (str, str)
        The namespace's prefix and its name.
    name : str
        The property.
    text : str
        Its value, any text.

    """
    prefix, uri = (part.encode() for part in namespace)
    key = prefix + b":" + name.encode()
    about = _ABOUT.search(packet)
    value = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").encode()
    description = (
        b'<rdf:Description xmlns:rdf="%s" rdf:about=%s xmlns:%s="%s"><%s>%s</%s></rdf:Description>'
        % (_RDF, about[1] if about else b'""', prefix, uri, key, value, key)
    )
    packet = packet or _NEW
    if b"\0" in packet:  # UTF-16 or UTF-32
        return None
    place = packet.rfind(b"</rdf:RDF")
    if place >= 0:
        return packet[:place] + description + b"\n" + packet[place:]
    empty = _EMPTY_RDF.search(packet)
    if empty is not None:
        whole = b"<rdf:RDF%s>%s</rdf:RDF>" % (empty[1] or b"", description)
        return packet[: empty.start()] + whole + packet[empty.end() :]
    return None


def without(packet: bytes, prefix: str, name: str) -> bytes:
    """Return a packet without a property of simple text, an element or an attribute."""
    key = f"{prefix}:{name}".encode()
    if key not in packet:
        return packet
    element = rb"<%s(?:\s[^<>]{0,300})?>[^<]*</%s\s*>" % (key, key)
    alone = rb"<rdf:Description%s>\s{0,99}%s\s{0,99}</rdf:Description>\n?" % (_NO_MORE, element)
    for pattern in (alone, element, rb"\s%s=\"[^\"<]*\"" % key, rb"\s%s='[^'<]*'" % key):
        packet = re.sub(pattern, b"", packet)
    return packet


def property_of(text: bytes, prefix: str, name: str) -> str | None:
    """Return the first value of a property of simple text, as an element or an attribute.

    Parameters
    ----------
    text : bytes
        A packet, or any bytes that contain one.
    prefix, name : str
        The property.

    """
    key = f"{prefix}:{name}".encode()
    match = re.search(rb"%s(?:>([^<]*)</|=\"([^\"<]*)\"|='([^'<]*)')" % key, text)
    if match is None:
        return None
    value = next(part for part in match.groups() if part is not None).decode("utf-8", "replace")
    for entity, sign in (("quot", '"'), ("apos", "'"), ("#34", '"'), ("#39", "'")):
        value = value.replace(f"&{entity};", sign)
    return value.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")


def upright(packet: bytes) -> bytes:
    """Return a packet with orientation 1, if it states an orientation."""
    return _ORIENTATION.sub(rb"\g<1>1", packet)


def with_size(packet: bytes, height: int, width: int) -> bytes:
    """Return a packet with this size of the picture, wherever it states one."""
    packet = _WIDTH.sub(rb"\g<1>%d" % width, packet)
    return _HEIGHT.sub(rb"\g<1>%d" % height, packet)


def scaled(packet: bytes, across: float, down: float) -> bytes:
    """Return a packet for a picture that was reduced by two factors.

    The resolution of the focal plane is in pixels of the picture, and becomes smaller. `with_size`
    changes the size.
    """

    def multiplied(match: re.Match[bytes]) -> bytes:
        top, bottom = int(match[3]), int(match[4] or 1)
        if not bottom:
            return match[0]
        number = top / bottom * (across if match[2] == b"X" else down)
        return b"%s%d/%d" % (match[1], round(_FINE * number), _FINE)

    return _RESOLUTION.sub(multiplied, packet)


def without_thumbnails(packet: bytes) -> bytes:
    """Return a packet without its thumbnails, which show the photo before the work."""
    for name in (b"xmp:Thumbnails", b"xap:Thumbnails"):
        start = packet.find(b"<" + name + b">")
        end = packet.find(b"</" + name + b">", start)
        if 0 <= start < end:
            packet = packet[:start] + packet[end + len(name) + 3 :]
    return packet


def merged(packet: bytes, more: bytes) -> bytes | None:
    """Join a packet and the extended XMP of a JPEG.

    None if the two do not make one well-formed packet.
    """
    opening = re.search(rb"<rdf:RDF(?:\s[^<>]{0,2000})?>", more)
    closing, place = more.rfind(b"</rdf:RDF"), packet.rfind(b"</rdf:RDF")
    if opening is None or closing < opening.end() or place < 0:
        return None
    packet = packet[:place] + more[opening.end() : closing] + packet[place:]
    packet = without(packet, _NOTE[0], _EXTENDED)
    return packet if _is_xml(packet) else None


def extended(packet: bytes, *keep: tuple[tuple[str, str], str]) -> tuple[bytes, bytes] | None:
    """Split a packet that is too long for a JPEG; None if it cannot be split.

    Parameters
    ----------
    packet : bytes
        The packet.
    *keep : (namespace, name)
        Properties of simple text that stay in the short packet.

    Returns
    -------
    short : bytes
        A short packet that refers to the long one by its MD5.
    long : bytes
        The rest, without its wrapper.

    """
    start, end = packet.find(b"<x:xmpmeta"), packet.rfind(b"</x:xmpmeta>")
    if not 0 <= start < end:
        return None
    long = packet[start : end + len(b"</x:xmpmeta>")]
    short: bytes | None = b""
    for namespace, name in keep:
        value = property_of(long, namespace[0], name)
        if value is not None and short is not None:
            long = without(long, namespace[0], name)
            short = insert(short, namespace, name, value)
    short = None if short is None else insert(short, _NOTE, _EXTENDED, _md5(long))
    return None if short is None else (short, long)


def guid(packet: bytes, more: bytes) -> bytes:
    """Return the GUID of a packet's extended XMP: the one in the packet, or else the MD5."""
    named = property_of(packet, _NOTE[0], _EXTENDED) or ""
    return (named if re.fullmatch("[0-9A-Fa-f]{32}", named) else _md5(more)).encode()


def without_padding(packet: bytes) -> bytes:
    """Return a packet without its padding, the blanks before its end that leave room for edits."""
    end = packet.rfind(_END)
    return packet if end < 0 else packet[:end].rstrip() + b"\n" + packet[end:]


def _md5(data: bytes) -> str:
    return hashlib.md5(data, usedforsecurity=False).hexdigest().upper()


def _is_xml(packet: bytes) -> bool:
    """Return whether a packet is well-formed, without unknown prefixes; entities are refused."""
    if b"<!" in packet:
        return False
    try:
        expat.ParserCreate(namespace_separator=" ").Parse(packet, True)  # noqa: FBT003
    except expat.ExpatError:
        return False
    return True
