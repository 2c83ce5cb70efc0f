from __future__ import annotations

import io
import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms, IptcImagePlugin

from deshake.errors import PhotoError
from deshake.formats.encoding import Decoded, Encoding
from deshake.formats.tiff import decode_tiff, encode_tiff
from deshake.formats.transfer import LINEAR
from deshake.metadata import exif
from deshake.metadata.exif import read_tree
from deshake.metadata.exif_editing import maker_note_at
from deshake.metadata.image_resources import with_iptc
from deshake.metadata.metadata import Metadata

if TYPE_CHECKING:
    from collections.abc import Callable


def tiff(codes: np.ndarray, **options: Any) -> bytes:
    stream = io.BytesIO()
    channels = codes.shape[2] if codes.ndim == 3 else 1
    if channels in {2, 4}:
        options.setdefault("extrasamples", ["unassalpha"])
    options.setdefault("photometric", "rgb" if channels > 2 else "minisblack")
    if options.get("planarconfig") == "separate":
        codes = np.moveaxis(codes, -1, 0)
    elif channels > 1:
        options["planarconfig"] = "contig"
    tifffile.imwrite(stream, codes, metadata=None, **options)
    return stream.getvalue()


def joined(decoded: Any) -> np.ndarray:
    if decoded.alpha is None:
        return decoded.codes
    return np.dstack([decoded.codes, decoded.alpha])


LAYOUTS: list[dict[str, Any]] = [
    {},
    {"byteorder": ">"},
    {"bigtiff": True},
    {"tile": (16, 32)},
    {"compression": "zlib", "predictor": True},
    {"compression": "zlib", "rowsperstrip": 7},
    {"planarconfig": "separate"},
    {"planarconfig": "separate", "tile": (16, 16), "byteorder": ">"},
]
KINDS = [
    (channels, options)
    for channels in (1, 2, 3, 4)
    for options in LAYOUTS
    if channels > 1 or "planarconfig" not in options
]


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize(("channels", "options"), KINDS, ids=str)
def test_every_layout_is_read_and_written_bit_for_bit(
    make_codes: Callable[..., np.ndarray], channels: int, depth: int, options: dict[str, Any]
) -> None:
    codes = make_codes(45, 37, channels, depth)
    decoded = decode_tiff(tiff(codes, **options))
    assert decoded.encoding.depth == depth
    assert decoded.encoding.grey == (channels < 3)
    assert np.array_equal(joined(decoded), codes)
    data = encode_tiff(decoded)
    assert np.array_equal(tifffile.imread(io.BytesIO(data)), codes)
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        assert len(file.pages) == 1
        page = file.pages.first
        assert page.compression == (8 if "compression" in options else 1)
        assert page.extrasamples == ((2,) if channels in {2, 4} else ())
    if channels != 2:
        read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        if channels != 4:  # OpenCV multiplies by alpha
            order = [2, 1, 0]
            assert np.array_equal(read if channels == 1 else read[..., order], codes)


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA", "P", "1"])
def test_lzw_of_eight_bits_is_read_and_written_as_deflate(
    make_codes: Callable[..., np.ndarray], mode: str
) -> None:
    picture = Image.fromarray(make_codes(33, 45, 4)).convert(mode)
    stream = io.BytesIO()
    picture.save(stream, "TIFF", compression="tiff_lzw")
    if mode == "1":
        with pytest.raises(PhotoError, match="unusual"):
            decode_tiff(stream.getvalue())
        return
    decoded = decode_tiff(stream.getvalue())
    wanted = np.asarray(picture.convert("RGB") if mode == "P" else picture)
    assert np.array_equal(joined(decoded), wanted)
    assert np.array_equal(tifffile.imread(io.BytesIO(encode_tiff(decoded))), wanted)


def test_packbits_is_read(make_codes: Callable[..., np.ndarray]) -> None:
    codes = make_codes(33, 45, 3) // 100
    stream = io.BytesIO()
    Image.fromarray(codes).save(stream, "TIFF", compression="packbits")
    assert np.array_equal(decode_tiff(stream.getvalue()).codes, codes)


@pytest.mark.parametrize("channels", [1, 3])
def test_lzw_of_sixteen_bits_is_read(make_codes: Callable[..., np.ndarray], channels: int) -> None:
    codes = make_codes(33, 45, channels, 16)
    swapped = codes if channels == 1 else codes[..., ::-1]
    data = cv2.imencode(".tif", swapped, [cv2.IMWRITE_TIFF_COMPRESSION, 5])[1].tobytes()
    assert np.array_equal(decode_tiff(data).codes, codes)


def test_metadata_are_copied(make_codes: Callable[..., np.ndarray], xmp: bytes) -> None:
    icc = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    exif = Image.Exif()
    exif[0x010E], exif[0x010F], exif[0x013B] = "a picture", "Canon", "somebody"
    exif[0x0112], exif[700] = 1, xmp
    exif._ifds[0x8769] = {0x920A: 5.8, 0x927C: b"maker\0note", 0x9003: "2009:03:03 20:22:38"}
    exif._ifds[0x8825] = {1: "N", 2: (48.0, 51.0, 30.0)}
    stream = io.BytesIO()
    Image.fromarray(make_codes(9, 8, 3)).save(
        stream, "TIFF", exif=exif.tobytes(), icc_profile=icc, dpi=(240, 240)
    )
    decoded = decode_tiff(stream.getvalue())
    assert decoded.metadata.tags().focal_mm == pytest.approx(5.8)
    data = encode_tiff(decoded)
    with Image.open(io.BytesIO(data)) as result, Image.open(stream) as source:
        assert result.info["icc_profile"] == icc
        assert result.info["xmp"] == xmp
        assert result.info["dpi"] == (240, 240)
        old, new = source.getexif(), result.getexif()
        assert (new[0x010E], new[0x010F], new[0x013B]) == ("a picture", "Canon", "somebody")
        assert dict(new.get_ifd(0x8769)) == dict(old.get_ifd(0x8769))
        assert dict(new.get_ifd(0x8825)) == dict(old.get_ifd(0x8825))
    assert read_tree(data).exif == read_tree(stream.getvalue()).exif
    again = decode_tiff(data)
    assert again.metadata == decoded.metadata
    assert encode_tiff(again) == data


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("compressed", [False, True])
def test_the_exif_block_keeps_its_place(
    make_codes: Callable[..., np.ndarray],
    make_exif: Callable[..., bytes],
    order: str,
    *,
    compressed: bool,
) -> None:
    codes, block = make_codes(70, 80, 3, 16), make_exif(order)
    encoding = Encoding("TIFF", depth=16, compressed=compressed)
    data = encode_tiff(Decoded(codes, None, encoding, Metadata(block)))
    assert data[8 : len(block)] == block[8:]
    assert maker_note_at(data) == maker_note_at(block)
    assert np.array_equal(tifffile.imread(io.BytesIO(data)), codes)
    again = decode_tiff(data)
    assert maker_note_at(again.metadata.exif) == maker_note_at(block)
    assert encode_tiff(again) == encode_tiff(decode_tiff(encode_tiff(again)))


def test_iptc_and_image_resources_have_their_tags(make_codes: Callable[..., np.ndarray]) -> None:
    iptc = b"\x1c\x02\x05\0\x05Title"
    metadata = Metadata(iptc=iptc, resources=with_iptc(b"", iptc))
    data = encode_tiff(Decoded(make_codes(9, 8), None, Encoding("TIFF", grey=True), metadata))
    assert decode_tiff(data).metadata.iptc == iptc
    assert decode_tiff(data).metadata.resources == metadata.resources
    with Image.open(io.BytesIO(data)) as picture:
        assert IptcImagePlugin.getiptcinfo(picture) == {(2, 5): b"Title"}


def test_tags_order_and_header_satisfy_a_strict_reader(
    make_codes: Callable[..., np.ndarray], make_exif: Callable[..., bytes]
) -> None:
    decoded = decode_tiff(tiff(make_codes(9, 8, 3)))
    object.__setattr__(decoded.metadata, "exif", make_exif(">"))
    data = encode_tiff(decoded)
    assert data[:4] == b"MM\0*"
    (offset,) = struct.unpack_from(">I", data, 4)
    assert offset % 2 == 0
    (count,) = struct.unpack_from(">H", data, offset)
    tags = [struct.unpack_from(">H", data, offset + 2 + 12 * i)[0] for i in range(count)]
    assert tags == sorted(set(tags))
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        assert file.pages.first.tags["ExifTag"].value["FocalLength"] == pytest.approx(5.8)


def test_white_is_zero_palette_and_few_bits(make_codes: Callable[..., np.ndarray]) -> None:
    codes = make_codes(9, 8, 1, 16)
    decoded = decode_tiff(tiff(codes, photometric="miniswhite"))
    assert np.array_equal(decoded.codes, 65535 - codes)
    palette = np.random.default_rng(3).integers(0, 256, (3, 256)).astype(np.uint16) * 257
    indices = make_codes(9, 8)
    decoded = decode_tiff(tiff(indices, photometric="palette", colormap=palette))
    assert np.array_equal(decoded.codes, (palette // 257).T[indices])
    bits = make_codes(9, 11) > 127
    decoded = decode_tiff(tiff(bits))
    assert np.array_equal(decoded.codes, np.where(bits, 255, 0))


def test_premultiplied_alpha_stays_marked(make_codes: Callable[..., np.ndarray]) -> None:
    codes = make_codes(9, 8, 4, 16)
    decoded = decode_tiff(tiff(codes, extrasamples=["assocalpha"]))
    with tifffile.TiffFile(io.BytesIO(encode_tiff(decoded))) as file:
        assert file.pages.first.extrasamples == (1,)
        assert np.array_equal(file.asarray(), codes)


def several(*subfiletypes: int) -> bytes:
    stream = io.BytesIO()
    with tifffile.TiffWriter(stream) as writer:
        for kind in subfiletypes:
            writer.write(np.zeros((8, 8), np.uint8), subfiletype=kind, metadata=None)
    return stream.getvalue()


def test_thumbnails_are_ignored_and_further_pictures_refused() -> None:
    assert decode_tiff(several(0, 1, 1)).codes.shape == (8, 8)
    with pytest.raises(PhotoError, match="holds 3 pictures"):
        decode_tiff(several(0, 2, 2))


@pytest.mark.parametrize(
    ("codes", "options", "match"),
    [
        (np.zeros((4, 4, 2), np.float32), {"extrasamples": [2]}, "floating-point TIFF"),
        (np.full((4, 4), np.nan, np.float32), {}, "not numbers"),
        (np.full((4, 4), 1e300), {}, "infinite"),
        (np.zeros((4, 4), np.int16), {}, "neither unsigned integers"),
        (np.zeros((4, 4), np.uint32), {}, "32 bits"),
        (np.zeros((4, 4, 4), np.uint8), {"photometric": "separated"}, "SEPARATED"),
        (np.zeros((4, 4, 5), np.uint8), {"extrasamples": [2, 0]}, "5 channels"),
        (np.zeros((4, 4), np.uint16), {"extratags": [(50706, 1, 4, bytes(4), True)]}, "RAW"),
    ],
)
def test_pixels_that_cannot_be_deblurred_are_refused(
    codes: np.ndarray, options: dict[str, Any], match: str
) -> None:
    if codes.shape[-1] == 4 and options.get("photometric") == "separated":
        options = options | {"extrasamples": []}
    with pytest.raises(PhotoError, match=match):
        decode_tiff(tiff(codes, **options))


@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}, {"tile": (16, 16)}])
def test_truncated_files_are_refused(
    make_codes: Callable[..., np.ndarray], options: dict[str, Any]
) -> None:
    data = tiff(make_codes(40, 40, 3, 16), **options)
    for size in (4, 9, 100, 300, len(data) // 2, len(data) - 2):
        with pytest.raises(PhotoError):
            decode_tiff(data[:size])


def test_missing_tiles_are_not_filled_in(make_codes: Callable[..., np.ndarray]) -> None:
    data = bytearray(tiff(make_codes(32, 32), tile=(16, 16)))
    with tifffile.TiffFile(io.BytesIO(bytes(data))) as file:
        place = file.pages.first.tags["ImageLength"].valueoffset
    struct.pack_into("<I", data, place, 50_000)
    with pytest.raises(PhotoError, match="cut short"):
        decode_tiff(bytes(data))


def test_a_bomb_is_refused_by_its_header(make_codes: Callable[..., np.ndarray]) -> None:
    data = bytearray(tiff(make_codes(4, 4)))
    with tifffile.TiffFile(io.BytesIO(bytes(data))) as file:
        for name in ("ImageWidth", "ImageLength"):
            struct.pack_into("<I", data, file.pages.first.tags[name].valueoffset, 40_000)
    with pytest.raises(PhotoError, match="40000 x 40000 pixels"):
        decode_tiff(bytes(data))


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("shape", [(30, 40), (30, 40, 3)])
@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}], ids=str)
def test_floating_point_keeps_values_above_white(
    kind: type, shape: tuple[int, ...], options: dict[str, Any]
) -> None:
    light = (np.random.default_rng(0).random(shape) * 5 - 1).astype(kind)
    photometric = "rgb" if len(shape) == 3 else "minisblack"
    stream = io.BytesIO()
    tifffile.imwrite(stream, light, photometric=photometric, metadata=None, **options)
    picture = decode_tiff(stream.getvalue())
    assert picture.encoding.depth == 32
    assert picture.encoding.transfer is LINEAR
    assert np.array_equal(picture.codes, light.astype(np.float32))
    written = encode_tiff(picture)
    again = tifffile.imread(io.BytesIO(written))
    assert again.dtype == np.float32
    assert np.array_equal(again, picture.codes)


@pytest.mark.parametrize("order", ["<", ">"])
def test_iptc_is_of_whole_words_and_loses_nothing(
    make_codes: Callable[..., np.ndarray], order: str
) -> None:
    iptc = b"\x1c\x02\x05\0\x05Title"
    tag = (33723, 7, len(iptc), iptc, True)
    decoded = decode_tiff(tiff(make_codes(8, 9, 3), byteorder=order, extratags=[tag]))
    data = encode_tiff(decoded)
    kind, count, raw = exif.read_first(data).values[33723]
    assert (kind, count, raw) == (4, 3, iptc + bytes(2))
    assert decoded.metadata.iptc == decode_tiff(data).metadata.iptc == iptc


@pytest.mark.parametrize("order", ["<", ">"])
def test_reference_black_and_white_are_kept(
    make_codes: Callable[..., np.ndarray], order: str
) -> None:
    values = (0, 1, 255, 1, 0, 1, 254, 1, 0, 1, 253, 1)
    tag = (532, 5, 6, values, True)
    decoded = decode_tiff(tiff(make_codes(8, 9, 3), byteorder=order, extratags=[tag]))
    for form in ("<", ">"):
        metadata = Metadata(exif.new_block(exif.Tree(form, {305: (2, 2, b"x\0")})))
        first = exif.read_first(encode_tiff(replace(decoded, metadata=metadata)))
        assert first.order == form
        assert first.numbers(532) == [0, 255, 0, 254, 0, 253]
