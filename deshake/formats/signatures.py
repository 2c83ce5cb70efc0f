"""The format of a file, by its first bytes rather than its name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from deshake.errors import PhotoError
from deshake.formats.encoding import READ_ONLY
from deshake.metadata import exif

if TYPE_CHECKING:
    from deshake.formats.encoding import Format

__all__ = ["TIFF_MARKS", "photo_format"]

TIFF_MARKS: Final = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")

_START: Final[dict[bytes, Format]] = {
    b"\xff\xd8\xff": "JPEG",
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\0\0\0\x0cjP  \r\n\x87\n": "JPEG2000",
    b"\xff\x4f\xff\x51": "JPEG2000",  # a bare code stream
    b"II\x1a\0\0\0HEAPCCDR": "RAW",  # Canon CRW
    b"FUJIFILMCCD-RAW": "RAW",
    b"IIRO": "RAW",  # Olympus
    b"IIRS": "RAW",
    b"MMOR": "RAW",
    b"IIU\0": "RAW",  # Panasonic, Leica
    b"\0MRM": "RAW",  # Minolta
    b"FOVb": "RAW",  # Sigma
}
_BRANDS: Final[dict[bytes, Format]] = {
    b"avif": "AVIF",
    b"heic": "HEIF",
    b"heix": "HEIF",
    b"heim": "HEIF",
    b"heis": "HEIF",
    b"mif1": "HEIF",
    b"crx ": "RAW",  # Canon CR3
}
_DNG_VERSION: Final = 50706
_COMPRESSION, _PHOTOMETRIC, _SUB_IFDS = 259, 262, 330
_MOSAICS: Final = {32803, 34892}  # colour filter array, and the linear light of a DNG
_SENSOR_CODES: Final = {32767, 32769, 32770, 34713, 65000, 65535}  # makers' own compression
_MAX_DIRECTORIES: Final = 16  # further ones are ignored


def photo_format(data: bytes, suffix: str = "") -> Format:
    """Detect the format of a photo.

    Parameters
    ----------
    data : bytes
        The file.
    suffix : str
        The ending of its name. With the ending of a RAW file, a TIFF or a file of no known format
        counts as RAW.

    Raises
    ------
    PhotoError
        If deshake cannot read the format.

    """
    for mark, form in _START.items():
        if data.startswith(mark):
            return form
    named = READ_ONLY.get(suffix.lower()) == "RAW"
    if data.startswith(TIFF_MARKS):
        return "RAW" if named or _holds_sensor_data(data) else "TIFF"
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "WEBP"
    if data[4:8] == b"ftyp":
        return _by_brand(data)
    if not data:
        raise PhotoError("the file is empty")
    if data.startswith(b"GIF8"):
        raise PhotoError(
            "a GIF, whose 256 colours are too few to deblur",
            hint="start from the photo as the camera wrote it",
        )
    if named:  # some makers' files begin with no mark at all
        return "RAW"
    raise PhotoError(
        "not a photo of a known format",
        hint="name a JPEG, PNG, TIFF, WebP, AVIF, JPEG 2000, HEIC or RAW file",
    )


def _by_brand(data: bytes) -> Format:
    """Detect the format of a file of boxes by its brands, the major one first."""
    size = min(int.from_bytes(data[:4], "big"), 256)
    brands = [data[8:12], *(data[at : at + 4] for at in range(16, size, 4))]
    if b"avis" in brands[:1] or b"hevc" in brands[:1]:
        raise PhotoError("a sequence of pictures", hint="take one still picture out of it")
    if b"avif" in brands:
        return "AVIF"
    for brand in brands:
        if brand in _BRANDS:
            return _BRANDS[brand]
    raise PhotoError("a video, or no picture", hint="name a photo")


def _holds_sensor_data(data: bytes) -> bool:
    """Return whether one of a TIFF's directories describes a sensor's data."""
    first = exif.read_first(data)
    if first is None or data[8:10] == b"CR":
        return first is not None
    if _DNG_VERSION in first.values:
        return True
    below = exif.read_sub_directories(data, first, _SUB_IFDS)[:_MAX_DIRECTORIES]
    return any(
        _MOSAICS.intersection(directory.numbers(_PHOTOMETRIC))
        or _SENSOR_CODES.intersection(directory.numbers(_COMPRESSION))
        for directory in (first, *below)
    )
