"""RAW files of cameras, and DNG: the sensor's data, demosaiced, in linear light.

LibRaw decodes and demosaics. The colours stay the sensor's own, with the camera's white balance.
So each channel clips by itself and has its own noise. When the result is written, a matrix converts
the colours to sRGB. White is the level where the channel with the smallest gain clips. Values that
the white balance lifts above white are cut off, as in the camera's own pictures.

References
----------
.. [1] Adobe, Digital Negative (DNG) Specification 1.7.1, 2023.
.. [2] LibRaw 0.22, https://www.libraw.org/docs

"""

from __future__ import annotations

import io
import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from deshake.errors import PhotoError
from deshake.formats.boxes import canon_exif
from deshake.formats.encoding import DAMAGED, Decoded, Encoding, check_size, decoding
from deshake.formats.jpeg import decode_jpeg
from deshake.formats.native_output import silenced
from deshake.metadata import exif
from deshake.metadata.exif_editing import maker_note_at
from deshake.metadata.metadata import Metadata
from deshake.metadata.profiles import GREY_PROFILE, SRGB_PROFILE, XYZ_FROM_SRGB

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from rawpy import ImageSizes, RawPy

    from deshake.formats.encoding import Matrix

__all__ = ["decode_raw"]

# EXIF orientation for each flip of LibRaw; its bits: upside down, mirrored, rows for columns.
_ORIENTATIONS: Final = {0: 1, 1: 2, 2: 4, 3: 3, 4: 5, 5: 8, 6: 6, 7: 7}
_SATURATED: Final = 0.995  # share of the range from black to white: a value above it clipped
_LEAST_CROP: Final = 0.55  # share of a side; LibRaw ignores a smaller crop
_LEAST_MATRIX: Final = 0.125  # least first element of a file's matrix that LibRaw uses
_PHOTO_TAGS: Final = 0x8000  # main tags below it describe the photo, most above it the sensor
_EXIF_TAGS: Final = (33434, 33437, 34850, 34855, *range(36864, 37389))  # main directories have them
_DNG_VERSION: Final = 50706
_SUB_IFDS: Final = 330
_PIXELS: Final = ((273, 279), (324, 325))  # tags of the places and lengths of strips, and of tiles
_COMPLAINTS: Final = ("Unexpected end of file", "data corrupted at")  # and LibRaw continues
_COPYRIGHT: Final = 33432


def decode_raw(data: bytes) -> Decoded:
    """Decode a RAW file to 16-bit linear light.

    Returns
    -------
    Decoded
        The codes are the sensor's colours, or grey if it has no filters; white is 65535.

    Raises
    ------
    PhotoError
        If the file is damaged, cut short or too large, or LibRaw does not know the camera.

    """
    import rawpy  # noqa: PLC0415 - needed for RAW files alone

    _check_length(data)
    try:
        with (
            silenced() as printed,
            decoding("RAW file"),
            rawpy.imread(io.BytesIO(data)) as raw,
        ):
            check_size(raw.sizes.raw_height, raw.sizes.raw_width, len(data))
            decoded = _decode(raw, data)
    except rawpy.LibRawError as error:
        reason = error.args[0] if error.args else error
        reason = reason.decode("ascii", "replace") if isinstance(reason, bytes) else str(reason)
        raise PhotoError(
            f"the RAW file cannot be read ({reason})",
            hint="convert it to a DNG or a 16-bit TIFF first",
        ) from error
    if any(complaint in line for line in printed for complaint in _COMPLAINTS):
        raise PhotoError("the RAW file is damaged or cut short", hint=DAMAGED)
    return decoded


def _check_length(data: bytes) -> None:
    """Refuse a DNG that ends before its pixels do: LibRaw may leave the rest black."""
    first = exif.read_first(data)
    if first is None or _DNG_VERSION not in first.values:
        return
    for directory in (first, *exif.read_sub_directories(data, first, _SUB_IFDS)):
        for places, sizes in _PIXELS:
            for at, size in zip(directory.numbers(places), directory.numbers(sizes), strict=False):
                if at + size > len(data):
                    raise PhotoError("the RAW file is damaged or cut short", hint=DAMAGED)


def _decode(raw: RawPy, data: bytes) -> Decoded:
    import rawpy  # noqa: PLC0415 - as above

    count = raw.num_colors
    space = rawpy.ColorSpace.sRGB if count == 4 else rawpy.ColorSpace.raw
    # with `user_flip` LibRaw does not turn the pixels: they are turned later
    turn = _ORIENTATIONS[raw.sizes.flip & 7]
    saturated = _saturated(raw, count)
    codes = raw.postprocess(
        gamma=(1, 1),
        output_bps=16,
        output_color=space,
        use_camera_wb=True,
        no_auto_bright=True,
        adjust_maximum_thr=0.0,  # white is the camera's, not the brightest pixel's
        user_flip=0,
    )
    if count == 1:
        codes = codes[..., 0]
    if saturated.shape[:2] != codes.shape[:2]:
        saturated = np.zeros(codes.shape, bool)  # LibRaw has resized or turned the pixels
    elif count == 4:  # each of the four colours is part of all three
        saturated = np.broadcast_to(saturated.any(-1, keepdims=True), codes.shape)
    saturated = saturated | (codes >= round(_SATURATED * 65535))
    rows, columns = _crop(raw.sizes, codes.shape)
    metadata = _metadata(raw, data, turn, grey=count == 1)
    encoding = Encoding("RAW", depth=16, grey=count == 1)
    if count == 3:
        gains = (raw.auto_whitebalance or [1.0] * 3)[:3]
        balance = tuple(gain / min(gains) for gain in gains)
        encoding = replace(encoding, matrix=_to_srgb(raw), balance=balance)
    return Decoded(
        np.ascontiguousarray(codes[rows, columns]),
        None,
        encoding,
        metadata,
        saturated=np.ascontiguousarray(saturated[rows, columns]),
    )


def _saturated(raw: RawPy, count: int) -> NDArray[np.bool_]:
    """Return where demosaicing made a channel from photosites at their white level.

    Demosaicing makes a channel from its photosites nearby: within one pixel in a Bayer pattern,
    within two in larger patterns. Without a mosaic, each pixel has its own value of each channel.
    """
    pattern = raw.raw_pattern
    black, white = raw.black_level_per_channel, raw.camera_white_level_per_channel
    levels = [min(raw.white_level, level or raw.white_level) for level in white or [0] * 4]
    tops = [dark + _SATURATED * (level - dark) for dark, level in zip(black, levels, strict=True)]
    photosites = raw.raw_image_visible
    if pattern is None:
        return np.asarray(photosites[..., :count] >= np.array(tops[:count]))
    height, width = photosites.shape
    reach = 0 if pattern.size == 1 else 3 if len(pattern) == 2 else 5
    out = np.zeros((height, width, count), np.uint8)
    sizes = raw.sizes
    for y, x in np.ndindex(pattern.shape):
        colour = int(pattern[y, x]) if count > 1 else 0
        # the pattern begins at the corner of the whole sensor, not of its visible part
        first = (y - sizes.top_margin) % len(pattern), (x - sizes.left_margin) % len(pattern)
        place = slice(first[0], None, len(pattern)), slice(first[1], None, len(pattern))
        channel = colour if colour < count else 1  # the second green is green
        out[..., channel][place] = photosites[place] >= tops[colour]
    if reach:
        for channel in range(count):
            out[..., channel] = cv2.dilate(out[..., channel], np.ones((reach, reach), np.uint8))
    saturated = out.astype(bool)
    return saturated[..., 0] if count == 1 else saturated


def _crop(sizes: ImageSizes, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return the rows and columns that the camera shows; demosaicing alone needs the others."""
    top, left = sizes.crop_top_margin - sizes.top_margin, sizes.crop_left_margin - sizes.left_margin
    height, width = sizes.crop_height, sizes.crop_width
    fits = (
        shape[:2] == (sizes.height, sizes.width)
        and top >= 0
        and left >= 0
        and top + height <= sizes.height
        and left + width <= sizes.width
        and height >= _LEAST_CROP * sizes.height
        and width >= _LEAST_CROP * sizes.width
    )
    return (slice(top, top + height), slice(left, left + width)) if fits else (slice(None),) * 2


def _to_srgb(raw: RawPy) -> Matrix | None:
    """Return the matrix from white-balanced sensor colours to linear sRGB; None if not known.

    It is the matrix that LibRaw uses: the file's own, else the inverse of the camera's response to
    sRGB. Both map white to white.
    """
    stated = np.asarray(raw.color_matrix, np.float64)[:, :3]
    response = np.asarray(raw.rgb_xyz_matrix, np.float64)[:3] @ XYZ_FROM_SRGB
    if stated[0, 0] > _LEAST_MATRIX:
        matrix = stated
    elif np.abs(np.linalg.det(response)) > 1e-6:
        matrix = np.linalg.inv(response / response.sum(1, keepdims=True))
    else:
        return None
    return tuple((float(a), float(b), float(c)) for a, b, c in matrix)


def _metadata(raw: RawPy, data: bytes, turn: int, *, grey: bool) -> Metadata:
    """Collect the metadata of the photo, with the profile of the result."""
    tree = exif.read_tree(data) or canon_exif(data) or _of_preview(raw) or _of_libraw(raw)
    tree.exif = {tag: tree.main[tag] for tag in _EXIF_TAGS if tag in tree.main} | tree.exif
    tree.main = {
        tag: value for tag, value in tree.main.items() if tag < _PHOTO_TAGS or tag == _COPYRIGHT
    }
    tree.main[exif.ORIENTATION] = (3, 1, struct.pack(f"{tree.order}H", turn))
    first = exif.read_first(data)
    blocks = {} if first is None else first.values
    return Metadata(
        exif.new_block(tree, note_at=maker_note_at(data)),
        blocks.get(exif.XMP, (0, 0, b""))[2],
        GREY_PROFILE if grey else SRGB_PROFILE,
        iptc=blocks.get(exif.IPTC, (0, 0, b""))[2],
        resources=blocks.get(exif.IMAGE_RESOURCES, (0, 0, b""))[2],
    )


def _of_preview(raw: RawPy) -> exif.Tree:
    """Read the EXIF of the embedded preview, where LibRaw adds the tags that it knows."""
    import rawpy  # noqa: PLC0415 - as above

    try:
        preview = raw.extract_thumb()
        if preview.format == rawpy.ThumbFormat.JPEG and isinstance(preview.data, bytes):
            return exif.read_tree(decode_jpeg(preview.data).metadata.exif)
    except (rawpy.LibRawError, PhotoError, NotImplementedError):
        pass
    return exif.Tree()


def _of_libraw(raw: RawPy) -> exif.Tree:
    """Make EXIF tags of the exposure that LibRaw reports."""
    other = raw.other
    numbers = {0x829A: other.shutter_speed, 0x829D: other.aperture, 0x920A: other.focal_length}
    tags: exif.Values = {
        tag: (5, 1, struct.pack("<II", round(number * 10**6), 10**6))
        for tag, number in numbers.items()
        if 0 < number < 4000
    }
    if 0 < other.iso_speed < 65536:
        tags[0x8827] = (3, 1, struct.pack("<H", round(other.iso_speed)))
    return exif.Tree("<", exif=tags)
