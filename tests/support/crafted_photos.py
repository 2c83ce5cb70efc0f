"""Photos made byte by byte, with metadata that break naive readers and writers."""

from __future__ import annotations

import io
import struct
import zlib

import cv2
import numpy as np
from PIL import Image, ImageCms

from .heic_writer import heic

__all__ = [
    "CITY",
    "HEIGHT",
    "ICC",
    "IPTC",
    "KINDS",
    "NOTE",
    "TITLE",
    "WIDTH",
    "codes",
    "photo",
    "written",
]

WIDTH, HEIGHT = 48, 32  # of the photo turned upright
KINDS = ("EXIF", "maker note", "GPS", "XMP", "IPTC", "profile")
"""Kinds of metadata."""

ICC = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
CITY, TITLE = "K\u00f6ln", "A title"
"""The caption in the XMP and the IPTC."""

IPTC = b"\x1c\x02\x05\0\x07A title\x1c\x02\x19\0\x04word"
NOTE = b"what the maker note points at"
"""The bytes at the offset in the maker note."""

_XMP = (
    b'<?xpacket begin="\xef\xbb\xbf" id="W5M0MpCehiHzreSzNTczkc9d"?>\n<x:xmpmeta '
    b'xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description rdf:about="" xmlns:photoshop="http://ns.adobe.com/photoshop/1.0/" '
    b'xmlns:tiff="http://ns.adobe.com/tiff/1.0/" tiff:Orientation="%d" photoshop:City="K\xc3\xb6ln"'
    b'/></rdf:RDF></x:xmpmeta>\n<?xpacket end="w"?>'
)

Entry = tuple[int, int, bytes]  # type, count, bytes


def _directory(entries: dict[int, Entry], at: int, further: int = 0) -> bytes:
    """Write a TIFF directory that lies at an offset, with its values behind it."""
    head, behind = struct.pack("<H", len(entries)), b""
    start = at + 2 + 12 * len(entries) + 4
    for tag, (kind, count, raw) in sorted(entries.items()):
        place = raw.ljust(4, b"\0") if len(raw) <= 4 else struct.pack("<I", start + len(behind))
        head += struct.pack("<HHI", tag, kind, count) + place
        behind += raw + bytes(len(raw) % 2) if len(raw) > 4 else b""
    return head + struct.pack("<I", further) + behind


def _text(value: bytes) -> Entry:
    return 2, len(value) + 1, value + b"\0"


def _number(kind: int, *values: int) -> Entry:
    return kind, len(values), struct.pack(f"<{len(values)}{'..HI'[kind - 1]}", *values)


def _tree(kinds: tuple[str, ...], turn: int, more: dict[int, Entry] | None = None) -> bytes:
    """Write an EXIF block: sound tags, odd ones, and a maker note that holds absolute offsets."""
    main = {274: _number(3, turn)} | (more or {})
    below, gps = {}, {}
    if "EXIF" in kinds:
        main |= {271: _text(b"Acme"), 305: _text(b"Firmware 1.0")}
        below |= {
            0x9286: (7, 11, b"\0\0no charset"[:11]),  # UserComment without its code
            0x920A: (5, 1, struct.pack("<II", 58, 10)),
            0x920B: (12, 1, struct.pack("<d", 0.5)),  # FlashEnergy, a rational number, as DOUBLE
            0xA002: _number(4, 4000),
            0xA003: _number(3, 3000),
            0xA301: _number(3, 1),  # SceneType as a number
        }
    if "maker note" in kinds:
        below[0x927C] = (7, 8 + len(NOTE), b"NOTE\0\0\0\0" + NOTE)
    if "GPS" in kinds:
        degrees = struct.pack("<6I", 48, 1, 51, 1, 30, 1)
        gps = {1: _text(b"N"), 2: (5, 3, degrees)}
    chain = [(34665, below), (34853, gps)]
    for tag, entries in chain:
        if entries:
            main[tag] = _number(4, 0)
    at = 8 + len(_directory(main, 8))
    parts = b""
    for tag, entries in chain:
        if entries:
            main[tag] = _number(4, at + len(parts))
            parts += _directory(entries, at + len(parts))
    thumbnail = b"\xff\xd8the old thumbnail\xff\xd9"
    link = at + len(parts)
    small = {513: _number(4, 0), 514: _number(4, len(thumbnail))}
    small[513] = _number(4, link + len(_directory(small, link)))
    block = (
        b"II*\0\x08\0\0\0" + _directory(main, 8, link) + parts + _directory(small, link) + thumbnail
    )
    if "maker note" not in kinds:
        return block
    note = block.index(b"NOTE") + 4
    return block[:note] + struct.pack("<I", note + 4) + block[note + 4 :]


def _resources() -> bytes:
    thumbnail = b"8BIM\x04\x0c\0\0" + struct.pack(">I", 14) + b"the old thumb\0"
    return (
        thumbnail + b"8BIM\x04\x04\0\0" + struct.pack(">I", len(IPTC)) + IPTC + bytes(len(IPTC) % 2)
    )


def codes(depth: int, channels: int) -> np.ndarray:
    """Make pixels that are all different, opaque, and lie on their left side."""
    kind = np.uint8 if depth == 8 else np.uint16
    y, x = np.mgrid[:WIDTH, :HEIGHT]  # turned upright: WIDTH x HEIGHT
    ramp = [(2 * x + 2 * y + 20 + 20 * c) * (np.iinfo(kind).max // 255) for c in range(channels)]
    picture = np.stack(ramp, -1).astype(kind)
    if channels in {2, 4}:
        picture[..., -1] = np.iinfo(kind).max
    return picture


def _chunk(name: bytes, content: bytes) -> bytes:
    check = struct.pack(">I", zlib.crc32(name + content))
    return struct.pack(">I", len(content)) + name + content + check


def _png(picture: np.ndarray, exif: bytes, xmp: bytes, iptc: bytes, icc: bytes) -> bytes:
    height, width, channels = picture.shape
    rows = picture.astype(picture.dtype.newbyteorder(">")).reshape(height, -1).view(np.uint8)
    head = struct.pack(
        ">IIBBBBB", width, height, 8 * picture.itemsize, (0, 4, 2, 6)[channels - 1], 0, 0, 0
    )
    out = b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", head)
    if icc:
        out += _chunk(b"iCCP", b"any\0\0" + zlib.compress(icc))
    if iptc:
        profile = f"\niptc\n{len(iptc):8}\n{iptc.hex()}\n".encode()
        out += _chunk(b"zTXt", b"Raw profile type iptc\0\0" + zlib.compress(profile))
    if xmp:
        out += _chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + xmp)
    filtered = np.hstack([np.zeros((height, 1), np.uint8), rows])
    return (
        out
        + _chunk(b"eXIf", exif)
        + _chunk(b"IDAT", zlib.compress(filtered.tobytes()))
        + _chunk(b"IEND", b"")
    )


def _jp2(picture: np.ndarray, exif: bytes, xmp: bytes) -> bytes:
    """Write a JP2 with boxes for EXIF and XMP."""
    order = [2, 1, 0, 3][: picture.shape[2]] if picture.shape[2] > 2 else [0]
    bare = cv2.imencode(".jp2", picture[..., order], [cv2.IMWRITE_JPEG2000_COMPRESSION_X1000, 1000])
    data = bare[1].tobytes()
    at = data.index(b"jp2c") - 4
    keys = b"JpgTiffExif->JP2", bytes.fromhex("be7acfcb97a942e89c71999491e3afac")
    boxes = b"".join(
        struct.pack(">I", 24 + len(block)) + b"uuid" + key + block
        for key, block in zip(keys, (exif, xmp), strict=True)
        if block
    )
    return data[:at] + boxes + data[at:]


def _avif(picture: np.ndarray, exif: bytes, xmp: bytes, icc: bytes) -> bytes:
    """Write an AVIF with OpenCV, which leaves the EXIF as it is, other than Pillow."""
    order = [2, 1, 0, 3][: picture.shape[2]] if picture.shape[2] > 2 else [0]
    blocks = {
        cv2.IMAGE_METADATA_EXIF: exif,
        cv2.IMAGE_METADATA_XMP: xmp,
        cv2.IMAGE_METADATA_ICCP: icc,
    }
    kept = {kind: np.frombuffer(block, np.uint8) for kind, block in blocks.items() if block}
    shown, how = np.ascontiguousarray(picture[..., order]), [cv2.IMWRITE_AVIF_QUALITY, 95]
    return cv2.imencodeWithMetadata(".avif", shown, list(kept), list(kept.values()), how)[
        1
    ].tobytes()


def _mosaic(picture: np.ndarray) -> np.ndarray:
    """Return the values of a sensor with a Bayer pattern (RGGB) for a picture."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    return np.take_along_axis(picture, (y % 2 + x % 2)[..., None], -1)


def _sensor(mosaic: np.ndarray) -> dict[int, Entry]:
    """Return the tags that make a TIFF a DNG."""
    unit = np.stack([np.eye(3).ravel(), np.ones(9)], -1).astype(int)
    return {
        254: _number(4, 0),
        258: _number(3, 16),
        262: _number(3, 32803),
        277: _number(3, 1),
        279: _number(4, mosaic.nbytes),
        33421: _number(3, 2, 2),
        33422: (1, 4, bytes((0, 1, 1, 2))),
        50706: (1, 4, bytes((1, 4, 0, 0))),
        50708: _text(b"Acme One"),
        50717: _number(4, 65535),
        50721: (10, 9, unit.astype("<i4").tobytes()),
        50728: (5, 3, struct.pack("<6I", 1, 1, 1, 1, 1, 1)),
        50778: _number(3, 21),
    }


def photo(form: str, depth: int, channels: int, kinds: tuple[str, ...], turn: int) -> bytes:
    """Write a photo of the ramps of `codes` that carries these kinds of metadata.

    Orientation 6 says that it lies on its left side, as the ramps do; 1 is for ramps upright.
    """
    picture = codes(depth, channels)
    return written(form, picture if turn == 6 else np.rot90(picture, -1), kinds, turn)


def written(form: str, picture: np.ndarray, kinds: tuple[str, ...], turn: int) -> bytes:
    """Write a picture (H, W, channels) of 8 or 16 bits with these kinds of metadata."""
    depth, channels = 8 * picture.itemsize, picture.shape[2]
    xmp = _XMP % turn if "XMP" in kinds else b""
    iptc = _resources() if "IPTC" in kinds else b""
    icc = ICC if "profile" in kinds and channels > 2 else b""
    if form == "PNG":
        return _png(picture, _tree(kinds, turn), xmp, iptc, icc)
    if form in {"TIFF", "RAW"}:
        height, width, _ = picture.shape
        more = {
            256: _number(4, width),
            257: _number(4, height),
            258: _number(3, *[depth] * channels),
            259: _number(3, 1),
            262: _number(3, 2 if channels > 2 else 1),
            273: _number(4, 0),
            277: _number(3, channels),
            278: _number(4, height),
            279: _number(4, picture.nbytes),
        }
        more |= {338: _number(3, 2)} if channels in {2, 4} else {}
        if form == "RAW":
            picture = _mosaic(picture)
            more |= _sensor(picture)
        more |= {700: (1, len(xmp), xmp)} if xmp else {}
        more |= {33723: (7, len(IPTC), IPTC)} if iptc else {}
        more |= {34377: (7, len(iptc), iptc)} if iptc else {}
        more |= {34675: (7, len(icc), icc)} if icc else {}
        more[273] = _number(4, len(_tree(kinds, turn, more)))
        return _tree(kinds, turn, more) + picture.tobytes()
    if form == "JPEG 2000":
        return _jp2(picture, _tree(kinds, turn), xmp)
    if form == "AVIF":
        return _avif(picture, _tree(kinds, turn), xmp, icc)
    if form == "HEIC":
        turns = {1: 0, 8: 1, 3: 2, 6: 3}[turn]  # which counts, and not what EXIF says
        shown = picture if depth == 8 else picture >> 6
        bits = 8 if depth == 8 else 10
        return heic(shown, depth=bits, exif=_tree(kinds, turn), xmp=xmp, icc=icc, turns=turns)
    options = {"exif": b"Exif\0\0" + _tree(kinds, turn)} | ({"icc_profile": icc} if icc else {})
    options |= {"xmp": xmp} if xmp else {}
    if form == "JPEG" and iptc:
        segment = b"Photoshop 3.0\0" + iptc
        options["extra"] = b"\xff\xed" + struct.pack(">H", len(segment) + 2) + segment
    stream = io.BytesIO()
    shown = Image.fromarray(picture[..., 0] if channels == 1 else picture)
    lossless = {"lossless": True} if form == "WebP" else {}
    shown.save(stream, form.upper(), quality=95, **lossless, **options)
    return stream.getvalue()
