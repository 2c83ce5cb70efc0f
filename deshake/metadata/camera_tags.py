"""The few tags that calibration needs: piexif reads sound blocks, `exif.Directory` all others.

piexif 1.1.3 trusts a block. A false count can cost it gigabytes of memory. Without an error, it
shortens a value that lies beyond the end, and a text without its NUL. It returns values without
their types, so one fraction looks like two whole numbers. Therefore piexif gets a block only if
each directory that it reads is sound, and each tag that calibration needs has a type of the
standard.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

from deshake.metadata import exif

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

__all__ = ["CameraTags", "read_camera_tags"]

_SIZE: Final = (0x0100, 0x0101)  # ImageWidth, ImageLength
_MAKE: Final = 0x010F
_MODEL: Final = 0x0110
_CROP_SIZE: Final = 0xC620  # DefaultCropSize of a DNG

_EXPOSURE: Final = 0x829A  # ExposureTime
_F_NUMBER: Final = 0x829D
_ISO: Final = 0x8827  # ISOSpeedRatings
_FOCAL: Final = 0x920A  # FocalLength
_PIXELS: Final = (0xA002, 0xA003)  # PixelXDimension, PixelYDimension
_ACROSS: Final = 0xA20E  # FocalPlaneXResolution
_DOWN: Final = 0xA20F  # FocalPlaneYResolution
_UNIT: Final = 0xA210  # FocalPlaneResolutionUnit
_ZOOM: Final = 0xA404  # DigitalZoomRatio
_FOCAL_35MM: Final = 0xA405  # FocalLengthIn35mmFilm
_LENS_MAKE: Final = 0xA433
_LENS_MODEL: Final = 0xA434

_MM_PER_UNIT: Final = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # by `_UNIT`; 4 and 5 are in use, too

_ASCII, _SHORT, _LONG, _FRACTION, _UNDEFINED, _SIGNED = 2, 3, 4, 5, 7, 9
_TEXTS: Final = frozenset({_MAKE, _MODEL, _LENS_MAKE, _LENS_MODEL})
_FRACTIONS: Final = frozenset({_EXPOSURE, _F_NUMBER, _FOCAL, _ZOOM, _ACROSS, _DOWN})
_INTEGERS: Final = frozenset({_ISO, _FOCAL_35MM, _UNIT, *_SIZE, *_PIXELS})
_POINTERS: Final = frozenset({exif.EXIF_POINTER, exif.GPS_POINTER, exif.INTEROP_POINTER})
_CLASSIC: Final = 42  # the version of TIFF that EXIF uses; 43 is BigTIFF
# The longest array that piexif gets. For each of 100 lengths, the struct module caches 32 bytes a
# number.
_MOST_NUMBERS: Final = 1024


@dataclass(frozen=True)
class CameraTags:
    """The camera's tags about itself and the exposure; None for missing and absurd values.

    Parameters
    ----------
    make, model : str
        As in EXIF, without surrounding blanks.
    focal_mm : float or None
        FocalLength in millimetres.
    focal_35mm : float or None
        FocalLengthIn35mmFilm in millimetres.
    focal_plane_px_per_mm : float or None
        FocalPlaneXResolution or, without it, FocalPlaneYResolution.
    squeeze : float
        FocalPlaneYResolution over FocalPlaneXResolution; 1 if one of them is missing.
    digital_zoom : float
        DigitalZoomRatio: the factor by which the camera enlarged the picture, >= 1.
    pixel_size : (int, int) or None
        Width and height of the original picture: PixelXDimension and PixelYDimension or, without
        them, ImageWidth and ImageLength, or a DNG's DefaultCropSize.
    lens_make, lens_model : str
        As in EXIF, without surrounding blanks.
    f_number : float or None
        FNumber.
    exposure_s : float or None
        Exposure time in seconds.
    iso : float or None
        Sensitivity.

    """

    make: str = ""
    model: str = ""
    focal_mm: float | None = None
    focal_35mm: float | None = None
    focal_plane_px_per_mm: float | None = None
    squeeze: float = 1.0
    digital_zoom: float = 1.0
    pixel_size: tuple[int, int] | None = None
    lens_make: str = ""
    lens_model: str = ""
    f_number: float | None = None
    exposure_s: float | None = None
    iso: float | None = None


class _Tags(Protocol):
    """The tags of a directory, from either reader."""

    def numbers(self, tag: int) -> list[float]:
        """Return a tag's numbers; fractions over 0 become nan, other types an empty list."""

    def text(self, tag: int) -> str:
        """Return a tag's text up to its first NUL, without surrounding blanks."""


@dataclass(frozen=True)
class _PiexifTags:
    """The tags of a directory as piexif returns them, of the types that `_has_type` accepts."""

    values: Mapping[int, Any]

    def numbers(self, tag: int) -> list[float]:
        """Return a tag's numbers; fractions over 0 become nan."""
        value = self.values.get(tag)
        if value is None:
            return []
        parts = value if tag == _CROP_SIZE else [value]
        return [_quotient(*part) if isinstance(part, tuple) else float(part) for part in parts]

    def text(self, tag: int) -> str:
        """Return a tag's text up to its first NUL, without surrounding blanks."""
        value: bytes = self.values.get(tag, b"")
        return value.split(b"\0", 1)[0].decode("utf-8", "replace").strip()


def read_camera_tags(block: bytes) -> CameraTags:
    """Read the tags that calibration needs; odd values read as None.

    Parameters
    ----------
    block : bytes
        An EXIF block, from its byte order mark on. It may be damaged.

    """
    return _camera_tags(*(_by_piexif(block) or _by_directories(block)))


def _by_piexif(block: bytes) -> tuple[_Tags, _Tags] | None:
    """Read the main and the EXIF directory by piexif; None if it cannot or should not."""
    if not _is_sound(block):
        return None
    import piexif  # type: ignore[import-untyped]  # noqa: PLC0415  only calibration needs it

    try:
        read = piexif.load(block)
    except Exception:  # noqa: BLE001  piexif does not document its exceptions
        return None
    return _PiexifTags(read["0th"]), _PiexifTags(read["Exif"])


def _by_directories(block: bytes) -> tuple[_Tags, _Tags]:
    """Read the main and the EXIF directory by `exif.read_directory`, as far as they can be read."""
    main = exif.read_first(block)
    if main is None:
        return _PiexifTags({}), _PiexifTags({})
    return main, exif.read_below(block, main, exif.EXIF_POINTER) or _PiexifTags({})


def _is_sound(block: bytes) -> bool:
    """Return whether piexif reads a block right, within time and memory that its size bounds."""
    main = exif.read_first(block)
    if main is None or len(block) > exif.LONGEST:
        return False
    try:
        (version,) = struct.unpack_from(f"{main.order}H", block, 2)
        return version == _CLASSIC and all(
            directory.whole
            and all(_has_type(tag, *value) for tag, value in directory.values.items())
            for directory in _directories(block, main)
        )
    except struct.error:
        return False


def _directories(block: bytes, main: exif.Directory) -> Iterator[exif.Directory]:
    """Yield all directories that piexif reads; struct.error if one of them is not there."""

    def at(place: float) -> exif.Directory:
        return exif.read_directory(block, main.order, int(place), big=False)

    yield main
    for place in main.numbers(exif.GPS_POINTER):
        yield at(place)
    for place in main.numbers(exif.EXIF_POINTER):
        yield (below := at(place))
        for further in below.numbers(exif.INTEROP_POINTER):
            yield at(further)
    (thumbnail,) = struct.unpack_from(f"{main.order}I", block, main.next_at)
    if thumbnail:
        yield at(thumbnail)


def _has_type(tag: int, kind: int, count: int, raw: bytes) -> bool:
    """Return whether piexif reads a value right, and an array of numbers is short."""
    if tag in _TEXTS:
        return kind == _ASCII and b"\0" in raw
    if tag in _FRACTIONS:
        return (kind, count) == (_FRACTION, 1)
    if tag in _INTEGERS:
        return kind in {_SHORT, _LONG, _SIGNED} and count == 1
    if tag in _POINTERS:
        return (kind, count) == (_LONG, 1)
    if tag == _CROP_SIZE:
        return kind in {_SHORT, _LONG, _FRACTION} and count == 2
    return count <= _MOST_NUMBERS or kind in {_ASCII, _UNDEFINED}


def _camera_tags(main: _Tags, below: _Tags) -> CameraTags:
    """Convert the tags of the main and the EXIF directory."""
    across, down = _positive(below, _ACROSS), _positive(below, _DOWN)
    squeeze = down / across if across and down else 1.0
    across = across or down
    unit = _MM_PER_UNIT.get(int(_positive(below, _UNIT) or 2))
    return CameraTags(
        make=main.text(_MAKE),
        model=main.text(_MODEL),
        focal_mm=_positive(below, _FOCAL),
        focal_35mm=_positive(below, _FOCAL_35MM),
        focal_plane_px_per_mm=across / unit if across and unit else None,
        squeeze=squeeze,
        digital_zoom=max(_positive(below, _ZOOM) or 1.0, 1.0),
        pixel_size=_size(below, _PIXELS) or _size(main, _SIZE) or _pair(main, _CROP_SIZE),
        lens_make=below.text(_LENS_MAKE),
        lens_model=below.text(_LENS_MODEL),
        f_number=_positive(below, _F_NUMBER),
        exposure_s=_positive(below, _EXPOSURE),
        iso=_positive(below, _ISO),
    )


def _quotient(top: int, bottom: int) -> float:
    return top / bottom if bottom else math.nan


def _positive(directory: _Tags, tag: int) -> float | None:
    """Return the first number of a tag if it is finite and > 0."""
    numbers = directory.numbers(tag)
    return numbers[0] if numbers and math.isfinite(numbers[0]) and numbers[0] > 0 else None


def _size(directory: _Tags, tags: tuple[int, int]) -> tuple[int, int] | None:
    """Return a width and a height that two tags state."""
    width, height = (int(_positive(directory, tag) or 0) for tag in tags)
    return (width, height) if width and height else None


def _pair(directory: _Tags, tag: int) -> tuple[int, int] | None:
    """Return a width and a height that one tag states."""
    numbers = directory.numbers(tag)
    if len(numbers) != 2 or not all(math.isfinite(n) and n >= 1 for n in numbers):
        return None
    return int(numbers[0]), int(numbers[1])
