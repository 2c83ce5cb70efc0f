"""XMP packets, changed as text: what is not changed stays as it was, byte for byte.

An XML library would write every packet anew, with other prefixes and without its padding. Only
UTF-8 is known, which is what XMP is in JPEG, PNG, TIFF and WebP.

References
----------
.. [1] Extensible Metadata Platform (XMP) Specification, Part 1 (ISO 16684-1) and Part 3, Adobe.

"""

from __future__ import annotations

import re
from typing import Final

__all__ = ["insert", "property_of", "upright", "without", "without_padding"]

_RDF: Final = b"http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_NEW: Final = (
    b'<?xpacket begin="\xef\xbb\xbf" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="%s">\n'
    b'</rdf:RDF></x:xmpmeta>\n<?xpacket end="w"?>' % _RDF
)
_END: Final = b"<?xpacket end"
_ORIENTATION: Final = re.compile(rb"(tiff:Orientation(?:=[\"']|>))[2-8](?=[\"']|</)")
_ABOUT: Final = re.compile(rb"rdf:about=(\"[^\"<]{0,200}\"|'[^'<]{0,200}')")
_NO_MORE: Final = rb"(?:\s(?:xmlns:\w+|rdf:about)=(?:\"[^\"<]{0,300}\"|'[^'<]{0,300}')){0,4}"
_EMPTY_RDF: Final = re.compile(rb"<rdf:RDF(\s[^<>]{0,2000}?)?/>")


def insert(packet: bytes, namespace: tuple[str, str], name: str, text: str) -> bytes | None:
    """Return a packet with one more property; None if it has no place for it.

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
    found = _EMPTY_RDF.search(packet)
    if found is not None:
        whole = b"<rdf:RDF%s>%s</rdf:RDF>" % (found[1] or b"", description)
        return packet[: found.start()] + whole + packet[found.end() :]
    return None


def without(packet: bytes, prefix: str, name: str) -> bytes:
    """Return a packet without a property of simple text, wherever it stands."""
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
        A packet, or anything that has one in it.
    prefix, name : str
        The property.

    """
    key = f"{prefix}:{name}".encode()
    found = re.search(rb"%s(?:>([^<]*)</|=\"([^\"<]*)\"|='([^'<]*)')" % key, text)
    if found is None:
        return None
    value = next(part for part in found.groups() if part is not None).decode("utf-8", "replace")
    for entity, sign in (("quot", '"'), ("apos", "'"), ("#34", '"'), ("#39", "'")):
        value = value.replace(f"&{entity};", sign)
    return value.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")


def upright(packet: bytes) -> bytes:
    """Return a packet that says orientation 1, if it tells any."""
    return _ORIENTATION.sub(rb"\g<1>1", packet)


def without_padding(packet: bytes) -> bytes:
    """Return a packet without the blanks before its end, which leave room to edit it in place."""
    end = packet.rfind(_END)
    return packet if end < 0 else packet[:end].rstrip() + b"\n" + packet[end:]
