"""PNG in and out, 8 and 16 bits, with its chunks.

This module reads and writes the chunks itself: metadata must be copied byte for byte, and neither
Pillow nor OpenCV writes grey with alpha at 16 bits. Pillow decodes pixels of 8 bits, OpenCV pixels
of 16 bits, from a copy of the file without its ancillary chunks.

References
----------
.. [1] Portable Network Graphics (PNG) Specification, third edition, W3C, 2025.

"""

from __future__ import annotations

import io
import struct
import zlib
from typing import TYPE_CHECKING, Final, cast

import numpy as np
from PIL.PngImagePlugin import PngImageFile

from deshake.errors import PhotoError
from deshake.formats.encoding import DAMAGED, Decoded, Encoding, check_size, decoding
from deshake.formats.opencv import imdecode
from deshake.formats.transfer import SRGB, Power
from deshake.metadata.density import exif_density, phys_density
from deshake.metadata.image_resources import with_iptc
from deshake.metadata.metadata import Metadata
from deshake.metadata.png_texts import RAW_PROFILE, profile_text, raw_profile
from deshake.metadata.profiles import cicp_profile

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from deshake.formats.transfer import Codes, Transfer

__all__ = ["SIGNATURE", "decode_png", "encode_png"]

SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_XMP: Final = b"XML:com.adobe.xmp\0"
_PIXEL_CHUNKS: Final = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
_CARRIED: Final = (b"cHRM", b"gAMA", b"sRGB", b"cICP", b"tEXt", b"zTXt", b"iTXt")
_PALETTE: Final = 3
_GREY_TYPES: Final = (0, 4)
_MAX_METADATA: Final = 1 << 26  # bytes of the largest decompressed profile or packet
_SRGB_GAMMA: Final = 45455  # the gAMA of files with sRGB's curve
_PIECE: Final = 1 << 20  # bytes decompressed at once
_ROWS: Final = 64  # rows filtered at once

Chunk = tuple[bytes, bytes]


def decode_png(data: bytes) -> Decoded:
    """Decode a still PNG: a palette to RGB, 1 to 4 bits to 8, a transparent colour to alpha.

    Raises
    ------
    PhotoError
        If the file is damaged or cut short, too large, or animated.

    """
    with decoding("PNG"):
        chunks = list(_chunks(data))
        width, height, bits, kind = struct.unpack_from(">IIBB", chunks[0][1])
        check_size(height, width, len(data))
        if any(name == b"acTL" for name, _ in chunks):
            raise PhotoError("an animated PNG", hint="take one still picture out of it")
        bare = SIGNATURE + b"".join(_pack(*chunk) for chunk in chunks if chunk[0] in _PIXEL_CHUNKS)
        grey = kind in _GREY_TYPES
        pixels = _decode_16(bare, chunks) if bits == 16 else _decode_8(bare, grey=grey)
        if pixels.shape[:2] != (height, width):
            raise PhotoError("the PNG is damaged", hint=DAMAGED)
        metadata, transfer, carried = _metadata(chunks)
    colours = 1 if grey else 3
    alpha = pixels[..., -1] if pixels.shape[2] > colours else None
    encoding = Encoding(
        "PNG",
        depth=16 if bits == 16 else 8,
        grey=grey,
        transfer=transfer,
        carried=carried,
    )
    codes = pixels[..., 0] if grey else pixels[..., :3]
    return Decoded(
        np.ascontiguousarray(codes),
        None if alpha is None else np.ascontiguousarray(alpha),
        encoding,
        metadata,
    )


def encode_png(picture: Decoded) -> bytes:
    """Encode codes of 8 or 16 bits as PNG."""
    layers = [picture.codes] if picture.alpha is None else [picture.codes, picture.alpha]
    pixels = np.dstack(layers)
    height, width, channels = pixels.shape
    header = struct.pack(
        ">IIBBBBB", width, height, 8 * pixels.itemsize, (0, 4, 2, 6)[channels - 1], 0, 0, 0
    )
    metadata = picture.metadata
    out = [SIGNATURE, _pack(b"IHDR", header)]
    if metadata.icc:
        out.append(_pack(b"iCCP", b"ICC profile\0\0" + zlib.compress(metadata.icc)))
    density = metadata.density or exif_density(metadata.exif)
    if density is not None and (physical := density.phys()):
        out.append(_pack(b"pHYs", physical))
    out.append(picture.encoding.carried)
    if metadata.exif:
        out.append(_pack(b"eXIf", metadata.exif))
    if metadata.xmp:
        out.append(_pack(b"iTXt", _XMP + bytes(4) + metadata.xmp))
    if metadata.iptc or metadata.resources:
        resources = with_iptc(metadata.resources, metadata.iptc)
        out.append(
            _pack(b"zTXt", RAW_PROFILE + b"iptc\0\0" + zlib.compress(profile_text(resources)))
        )
    out.extend(_pack(b"IDAT", part) for part in _compress(pixels))
    out.append(_pack(b"IEND", b""))
    return b"".join(out)


def _chunks(data: bytes) -> Iterator[Chunk]:
    """Walk over the chunks up to the last one; damaged ancillary chunks are skipped."""
    at = len(SIGNATURE)
    name = b""
    while name != b"IEND":
        size, name = struct.unpack_from(">I4s", data, at)
        content = data[at + 8 : at + 8 + size]
        (check,) = struct.unpack_from(">I", data, at + 8 + size)
        at += 12 + size
        if zlib.crc32(name + content) == check:
            yield name, content
        elif name in _PIXEL_CHUNKS:
            raise PhotoError("the PNG is damaged (wrong checksum)", hint=DAMAGED)


def _pack(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + _checksum(name, content)


def _checksum(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", zlib.crc32(content, zlib.crc32(name)))


def _decode_8(bare: bytes, *, grey: bool) -> Codes:
    """Decode up to 8 bits a sample to (H, W, C), C from grey to RGBA."""
    picture = PngImageFile(io.BytesIO(bare))
    transparent = picture.mode in {"LA", "RGBA"} or "transparency" in picture.info
    mode = ("LA" if grey else "RGBA") if transparent else ("L" if grey else "RGB")
    pixels = np.asarray(picture if picture.mode == mode else picture.convert(mode))
    return np.atleast_3d(pixels)


def _decode_16(bare: bytes, chunks: list[Chunk]) -> Codes:
    """Decode 16 bits a sample to (H, W, C), C from grey to RGBA."""
    _check_stream(chunks)
    pixels = np.atleast_3d(imdecode(bare))
    kind = chunks[0][1][9]
    if kind == 4:  # grey and alpha, which OpenCV widens to RGBA
        return pixels[..., [0, 3]]
    key = next((content for name, content in chunks if name == b"tRNS"), None)
    if kind == 0 and key is not None:  # this grey value is transparent
        alpha = np.where(pixels == int.from_bytes(key, "big"), 0, 65535).astype(np.uint16)
        return np.dstack([pixels, alpha])
    return pixels


def _check_stream(chunks: list[Chunk]) -> None:
    """Refuse compressed pixels that are damaged or end too soon.

    OpenCV's decoder prints an error, or leaves the rest of the picture blank.
    """
    width, height, _, kind, _, _, interlaced = struct.unpack(">IIBBBBB", chunks[0][1])
    stream = zlib.decompressobj()
    length = 0
    for content in (content for name, content in chunks if name == b"IDAT"):
        rest = content
        while rest and not stream.eof:
            length += len(stream.decompress(rest, _PIECE))
            rest = stream.unconsumed_tail
    row = 1 + 2 * width * {0: 1, 2: 3, 4: 2, 6: 4}[kind]
    if not stream.eof or (length < height * row and not interlaced):
        raise PhotoError("the PNG is damaged or cut short", hint=DAMAGED)


def _metadata(chunks: list[Chunk]) -> tuple[Metadata, Transfer, bytes]:
    """Sort the ancillary chunks: metadata, transfer curve, and chunks that are copied unchanged.

    Of several chunks of a kind that should be single, the first counts.
    """
    blocks: dict[str, bytes] = {}
    raw: dict[str, bytes] = {}
    carried = b""
    contents = dict(chunks)
    for name, content in chunks:
        if name == b"eXIf":
            blocks.setdefault("exif", content.removeprefix(b"Exif\0\0"))
        elif name == b"iCCP":
            blocks.setdefault("icc", _inflate(content.split(b"\0", 1)[1][1:]))
        elif name == b"iTXt" and content.startswith(_XMP):
            packed, rest = content[len(_XMP)], content[len(_XMP) + 2 :]
            text = rest.split(b"\0", 2)[2]
            blocks.setdefault("xmp", _inflate(text) if packed else text)
        elif content.startswith(RAW_PROFILE) and (profile := _raw_profile(name, content)):
            raw = profile | raw
        elif name in _CARRIED:
            carried += _pack(name, content)
    if len(contents.get(b"cICP", b"")) == 4:  # it has priority over all others
        numbers = cicp_profile(*contents[b"cICP"][:2])
        blocks["icc"] = numbers or blocks.get("icc", b"")
    transfer: Transfer = SRGB
    if b"gAMA" in contents and b"sRGB" not in contents and b"cICP" not in contents:
        (gamma,) = struct.unpack(">I", contents[b"gAMA"])
        if 25000 <= gamma <= 300000 and abs(gamma - _SRGB_GAMMA) > 100:
            transfer = Power(100000 / gamma)
    density = next((phys_density(content) for name, content in chunks if name == b"pHYs"), None)
    return Metadata(**(raw | blocks), density=density), transfer, carried


def _raw_profile(name: bytes, content: bytes) -> dict[str, bytes]:
    """Read metadata from a text; empty if it is unreadable or an ordinary text."""
    text = content.partition(b"\0")[2]
    if name == b"zTXt":
        try:
            text = _inflate(text[1:])
        except (PhotoError, zlib.error):
            return {}
    return raw_profile(content, text)


def _inflate(packed: bytes) -> bytes:
    """Decompress a profile or packet; refuse one that grows too large."""
    stream = zlib.decompressobj()
    out = stream.decompress(packed, _MAX_METADATA)
    if not stream.eof:
        raise PhotoError("the PNG's metadata is damaged or too large", hint=DAMAGED)
    return out


def _compress(pixels: Codes) -> Iterator[bytes]:
    """Filter and compress the pixels (H, W, C), a few rows at a time.

    Each row uses one of the filters Sub, Up, Average and Paeth: the one with the smallest sum of
    differences, as the specification recommends [1]_.
    """
    height, width, channels = pixels.shape
    step = channels * pixels.itemsize  # bytes from a pixel to its left neighbour
    stream = zlib.compressobj(6)
    above = np.zeros((1, step + width * step), np.uint8)
    for first in range(0, height, _ROWS):
        block = pixels[first : first + _ROWS].astype(pixels.dtype.newbyteorder(">"))
        rows = np.zeros((len(block), step + width * step), np.uint8)
        rows[:, step:] = block.reshape(len(block), -1).view(np.uint8)
        yield stream.compress(_filter(rows, np.vstack([above, rows[:-1]]), step).tobytes())
        above = rows[-1:]
    yield stream.flush()


def _filter(rows: NDArray[np.uint8], above: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Filter rows of bytes that begin with an empty pixel; the filter's type leads each result."""
    x, b = rows[:, step:], above[:, step:]
    a, c = rows[:, :-step].astype(np.int16), above[:, :-step].astype(np.int16)
    up = b.astype(np.int16)
    pa, pb, pc = np.abs(up - c), np.abs(a - c), np.abs(a + up - 2 * c)
    paeth = np.where((pa <= pb) & (pa <= pc), a, np.where(pb <= pc, up, c))
    best = np.empty((len(rows), 1 + x.shape[1]), np.uint8)
    least = np.full(len(rows), np.iinfo(np.int64).max)
    for kind, guess in ((1, a), (2, up), (3, (a + up) >> 1), (4, paeth)):
        rest = x - guess.astype(np.uint8)
        cost = np.abs(rest.view(np.int8).astype(np.int16)).sum(1, dtype=np.int64)
        better = cost < least
        best[better, 0] = kind
        best[better, 1:] = rest[better]
        least[better] = cost[better]
    return cast("NDArray[np.uint8]", best)
