"""TIFF in and out, 8 and 16 bits and floating point, with the tags of its directories.

tifffile decodes the pixels. Without further libraries it cannot decompress LZW and JPEG: there
Pillow decodes 8 bits, and OpenCV 16 bits. Results are written uncompressed or with deflate.
"""

from __future__ import annotations

import io
import logging
import math
import struct
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import tifffile
from PIL.TiffImagePlugin import TiffImageFile
from tifffile import COMPRESSION, PHOTOMETRIC, SAMPLEFORMAT, TiffFile, TiffPage

from deshake.errors import PhotoError
from deshake.formats.encoding import DAMAGED, Decoded, Encoding, check_size, decoding
from deshake.formats.native_output import silenced
from deshake.formats.opencv import imdecode
from deshake.formats.transfer import LINEAR, SRGB
from deshake.metadata import exif
from deshake.metadata.exif_editing import maker_note_at, pointers
from deshake.metadata.image_resources import without_padding
from deshake.metadata.metadata import Metadata

if TYPE_CHECKING:
    from deshake.formats.transfer import Codes, Depth

__all__ = ["decode_tiff", "encode_tiff"]

# tifffile logs oddities of a file; without a handler Python would print them.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

_DNG_VERSION: Final = 50706
_REDUCED: Final = 1  # the bit of NewSubfileType that marks a thumbnail
_ASSOCIATED, _UNASSOCIATED = 1, 2
_STRIPS: Final = 273  # StripOffsets
_REFERENCE: Final = 532  # ReferenceBlackWhite
_MAX_PAGES: Final = 64  # searched for pictures beside thumbnails
_ALONE: Final = {  # the methods that tifffile knows without further libraries
    COMPRESSION.NONE,
    COMPRESSION.ADOBE_DEFLATE,
    COMPRESSION.DEFLATE,
    COMPRESSION.PACKBITS,
}
_FLOAT_PREDICTOR: Final = 3
_DEPTHS: Final[dict[type, Depth]] = {np.uint8: 8, np.uint16: 16, np.float32: 32}
_COLOURS: Final = {
    PHOTOMETRIC.MINISWHITE: 1,
    PHOTOMETRIC.MINISBLACK: 1,
    PHOTOMETRIC.RGB: 3,
    PHOTOMETRIC.PALETTE: 1,
    PHOTOMETRIC.YCBCR: 3,
}


def decode_tiff(data: bytes) -> Decoded:
    """Decode a TIFF with one picture (and thumbnails of it, which are ignored).

    Raises
    ------
    PhotoError
        If the file is damaged or cut short, too large, or holds several pictures. If its pixels
        are neither grey nor RGB, or are not integers of up to 16 bits or floating-point numbers.

    """
    with decoding("TIFF"), TiffFile(io.BytesIO(data)) as file:
        page = _only_page(file)
        check_size(page.imagelength, page.imagewidth, len(data))
        colours = _check_kind(page)
        pixels = _decode_page(page, data)
        if page.photometric == PHOTOMETRIC.MINISWHITE:
            pixels = ~pixels
        if page.photometric == PHOTOMETRIC.PALETTE:
            pixels, colours = _look_up(pixels, page), 3
        first = exif.read_first(data)
        values = {} if first is None else first.values
        note_at = maker_note_at(data)
        metadata = Metadata(
            exif=exif.new_block(exif.read_tree(data), note_at=note_at),
            xmp=values.get(exif.XMP, (0, 0, b""))[2],
            icc=values.get(exif.ICC, (0, 0, b""))[2],
            iptc=without_padding(values.get(exif.IPTC, (0, 0, b""))[2]),
            resources=values.get(exif.IMAGE_RESOURCES, (0, 0, b""))[2],
        )
        if page.sampleformat == SAMPLEFORMAT.IEEEFP:
            pixels = _finite(pixels)
        encoding = Encoding(
            "TIFF",
            depth=_DEPTHS[pixels.dtype.type],
            transfer=LINEAR if page.sampleformat == SAMPLEFORMAT.IEEEFP else SRGB,
            grey=colours == 1,
            compressed=page.compression != COMPRESSION.NONE,
            premultiplied=tuple(page.extrasamples) == (_ASSOCIATED,),
            carried=_reference(first) if page.photometric == PHOTOMETRIC.RGB else b"",
        )
    has_alpha = pixels.shape[2] > colours
    codes = pixels[..., 0] if colours == 1 else pixels[..., :3]
    alpha = np.ascontiguousarray(pixels[..., -1]) if has_alpha else None
    moved = maker_note_at(metadata.exif) != note_at
    notes = ("its maker note has moved: some programs may not read all of it",) if moved else ()
    return Decoded(np.ascontiguousarray(codes), alpha, encoding, metadata, notes=notes)


def encode_tiff(picture: Decoded) -> bytes:
    """Encode codes of any depth as TIFF, in the byte order of the EXIF block."""
    encoding, metadata = picture.encoding, picture.metadata
    tree = exif.read_tree(metadata.exif)
    pixels, options = picture.codes, dict[str, Any]()
    if picture.alpha is not None:
        pixels = cast("Codes", np.dstack([pixels, picture.alpha]))
        options["extrasamples"] = [_ASSOCIATED if encoding.premultiplied else _UNASSOCIATED]
    if encoding.compressed:
        options |= {"compression": "zlib", "predictor": encoding.depth < 32}
    stream = io.BytesIO()
    tifffile.imwrite(
        stream,
        pixels,
        photometric="minisblack" if encoding.grey else "rgb",
        planarconfig="contig" if pixels.ndim == 3 else None,
        metadata=None,
        software=False,
        byteorder="<" if tree.order == "<" else ">",
        **options,
    )
    return _with_metadata(stream.getvalue(), metadata, encoding.carried)


def _with_metadata(written: bytes, metadata: Metadata, reference: bytes) -> bytes:
    """Put metadata into a TIFF that has none, and that has the byte order of the metadata.

    The file begins with the EXIF block, so that offsets from the beginning stay valid; then come
    the pixels, and then a new main directory.
    """
    first = exif.read_first(written)
    if first is None:
        msg = "tifffile wrote no TIFF"
        raise RuntimeError(msg)
    tree, block = exif.read_tree(metadata.exif), metadata.exif
    links = pointers(block)
    if links is not None:
        shift = len(block) + -len(block) % 16
        kind, count, raw = first.values[_STRIPS]
        code = f"{tree.order}{count}{'H' if kind == 3 else 'I'}"
        places = [shift + place for place in struct.unpack(code, raw)]
        first.values[_STRIPS] = 4, count, struct.pack(f"{tree.order}{count}I", *places)
        written = block.ljust(shift, b"\0") + written
        tree = exif.Tree(tree.order, tree.main | links)
    density = {} if metadata.density is None else metadata.density.tags(tree.order)
    tree.main = first.values | density | tree.main
    for tag, kind, value in (
        (exif.XMP, 1, metadata.xmp),
        (exif.IPTC, 4, metadata.iptc + bytes(-len(metadata.iptc) % 4)),
        (exif.IMAGE_RESOURCES, 1, metadata.resources),
        (exif.ICC, 7, metadata.icc),
    ):
        if value:
            tree.main[tag] = kind, len(value) // exif.SIZES[kind], value
    if reference:
        numbers = struct.unpack("<12I", reference)
        tree.main[_REFERENCE] = 5, 6, struct.pack(f"{tree.order}12I", *numbers)
    return exif.append_tree(written, tree)


def _reference(first: exif.Directory | None) -> bytes:
    """Return the reference black and white of RGB pixels, little-endian; empty if there is none."""
    kind, count, raw = (0, 0, b"") if first is None else first.values.get(_REFERENCE, (0, 0, b""))
    if first is None or (kind, count) != (5, 6):
        return b""
    return struct.pack("<12I", *struct.unpack(f"{first.order}12I", raw))


def _only_page(file: TiffFile) -> TiffPage:
    """Return the only picture of a file; a page without a size is a thumbnail, as in EXIF."""
    pages = []
    for index in range(_MAX_PAGES):
        try:
            pages.append(file.pages.get(index, validate=False))
        except IndexError:
            break
    page = pages[0]
    if not isinstance(page, TiffPage):
        raise PhotoError("the TIFF is damaged", hint=DAMAGED)
    if _DNG_VERSION in page.tags or (page.subfiletype & _REDUCED and page.subifds):
        raise PhotoError(
            "a camera's RAW file, which cannot be read here",
            hint="convert it to a 16-bit TIFF first",
        )
    others = [
        p
        for p in pages[1:]
        if isinstance(p, TiffPage)
        and not p.subfiletype & _REDUCED
        and p.imagewidth
        and p.imagelength
    ]
    if others:
        raise PhotoError(
            f"holds {1 + len(others)} pictures", hint="split it into files of one picture each"
        )
    return page


def _check_kind(page: TiffPage) -> int:
    """Check that the pixels are of a kind that can be deblurred; return the number of colours."""
    colours = _COLOURS.get(cast("PHOTOMETRIC", page.photometric))
    if colours is None:
        name = getattr(page.photometric, "name", str(page.photometric))
        raise PhotoError(
            f"a {name} TIFF: only grey and RGB photos can be deblurred",
            hint="convert it to RGB with its colour profile first",
        )
    extra = page.samplesperpixel - colours
    if page.sampleformat == SAMPLEFORMAT.IEEEFP and page.photometric in {
        PHOTOMETRIC.MINISBLACK,
        PHOTOMETRIC.RGB,
    }:
        if extra or page.compression not in _ALONE or page.predictor == _FLOAT_PREDICTOR:
            raise PhotoError(
                "an unusual kind of floating-point TIFF", hint="save it uncompressed, without alpha"
            )
        return colours
    if page.sampleformat != SAMPLEFORMAT.UINT:
        raise PhotoError(
            "its pixels are neither unsigned integers nor floating-point numbers",
            hint="convert it to 16 bits a channel first",
        )
    allowed = {1, 2, 4, 8} if colours == 1 else {8}
    if page.bitspersample not in allowed | {16}:
        raise PhotoError(
            f"has {page.bitspersample} bits a channel", hint="convert it to 8 or 16 bits a channel"
        )
    if not 0 <= extra <= 1 or page.imagedepth != 1:
        raise PhotoError(
            f"has {page.samplesperpixel} channels", hint="keep grey or RGB, and at most one alpha"
        )
    return colours


def _decode_page(page: TiffPage, data: bytes) -> Codes:
    """Decode to (H, W, C), the colours first, then alpha."""
    if len(page.dataoffsets) != math.prod(page.chunked):
        raise PhotoError("the TIFF is damaged or cut short", hint=DAMAGED)
    for offset, size in zip(page.dataoffsets, page.databytecounts, strict=True):
        if size == 0 or offset + size > len(data):
            raise PhotoError("the TIFF is damaged or cut short", hint=DAMAGED)
    shape = (page.imagelength, page.imagewidth, page.samplesperpixel)
    palette = page.photometric == PHOTOMETRIC.PALETTE
    if page.compression in _ALONE and page.photometric != PHOTOMETRIC.YCBCR:
        planes = page.asarray().reshape(page.shaped)  # plane, depth, row, column, sample
        pixels = planes[0, 0] if len(planes) == 1 else np.moveaxis(planes[:, 0, :, :, 0], 0, -1)
        if page.bitspersample < 8:
            top = 1 if palette else 255 // ((1 << page.bitspersample) - 1)
            pixels = pixels.astype(np.uint8) * np.uint8(top)
    elif page.photometric == PHOTOMETRIC.MINISWHITE or page.bitspersample < 8:
        raise _unusual()  # Pillow and OpenCV read these in different ways
    else:
        pixels = np.atleast_3d(
            imdecode(data) if page.bitspersample == 16 else _decode_by_pillow(data)
        )
    if pixels.shape != shape:
        raise _unusual()
    return cast("Codes", np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("=")))


def _finite(pixels: Codes) -> Codes:
    """Return floating-point pixels in single precision; refuse infinities and nan."""
    with np.errstate(over="ignore"):
        single = pixels.astype(np.float32)
    if not np.isfinite(single).all():
        raise PhotoError("some of its pixels are infinite or not numbers")
    return cast("Codes", single)


def _decode_by_pillow(data: bytes) -> Codes:
    with silenced():
        picture = TiffImageFile(io.BytesIO(data))
        if picture.mode not in {"L", "LA", "P", "RGB", "RGBA"}:
            raise _unusual()
        return np.asarray(picture)


def _unusual() -> PhotoError:
    return PhotoError("an unusual kind of TIFF", hint="save it uncompressed first")


def _look_up(pixels: Codes, page: TiffPage) -> Codes:
    """Turn palette indices (H, W, 1) into 8-bit RGB."""
    palette = np.asarray(page.colormap)  # (3, colours), 0..65535; old writers use 0..255
    colours = (palette.T >> (8 if palette.max() > 255 else 0)).astype(np.uint8)
    return cast("Codes", colours[pixels[..., 0]])
