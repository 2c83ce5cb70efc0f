"""EXIF, XMP and ICC as a photo holds them, and the few tags that calibration needs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from deshake.metadata import exif, exif_editing, xmp

if TYPE_CHECKING:
    from deshake.metadata.density import Density

__all__ = ["CameraTags", "Metadata"]

_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # FocalPlaneResolutionUnit; 4, 5 are in use


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
        FocalPlaneYResolution over FocalPlaneXResolution; 1 where one of them is missing.
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


@dataclass(frozen=True)
class Metadata:
    """The metadata blocks of a photo, byte for byte.

    Parameters
    ----------
    exif : bytes
        The EXIF block, from its byte order mark on; of a TIFF, the tags of its directories that
        do not describe the pixels. Empty: none.
    xmp : bytes
        The XMP packet. Empty: none.
    icc : bytes
        The ICC profile. Empty: none.
    iptc : bytes
        The IPTC records (IIM). Empty: none.
    resources : bytes
        Photoshop's image resources, which may hold the IPTC records too. Empty: none.
    extended_xmp : bytes
        The part of a JPEG's XMP that its packet has no room for. Empty: none.
    density : Density, optional
        The density in a JPEG's JFIF header or a PNG's chunk pHYs.

    """

    exif: bytes = b""
    xmp: bytes = b""
    icc: bytes = b""
    iptc: bytes = b""
    resources: bytes = b""
    extended_xmp: bytes = b""
    density: Density | None = None

    @property
    def orientation(self) -> int:
        """The EXIF orientation, 1 to 8."""
        return exif.orientation(self.exif)

    def upright(self) -> Metadata:
        """Return the metadata of the photo turned upright: orientation 1, in EXIF and in XMP.

        Nothing else changes.
        """
        if self.orientation == 1:
            return self
        return replace(self, exif=exif_editing.upright(self.exif), xmp=xmp.upright(self.xmp))

    def scaled(self, across: float, down: float) -> Metadata:
        """Return the metadata of the photo reduced by two factors, in EXIF and in XMP.

        What is stated in pixels, but for the size of the picture, becomes smaller.
        """
        return replace(
            self,
            exif=exif_editing.scaled(self.exif, across, down),
            xmp=xmp.scaled(self.xmp, across, down),
        )

    def tags(self) -> CameraTags:
        """Read the tags that calibration needs; odd values read as None."""
        main = exif.read_first(self.exif)
        if main is None:
            return CameraTags()
        size = _size(main, (0x0100, 0x0101)) or _pair(main, 0xC620)
        camera = CameraTags(make=main.text(0x010F), model=main.text(0x0110), pixel_size=size)
        below = exif.read_below(self.exif, main, exif.EXIF_POINTER)
        if below is None:
            return camera
        across, down = _positive(below, 0xA20E), _positive(below, 0xA20F)
        squeeze = down / across if across and down else 1.0
        across = across or down
        unit = _MM_PER_UNIT.get(int(_positive(below, 0xA210) or 2))
        return replace(
            camera,
            focal_mm=_positive(below, 0x920A),
            focal_35mm=_positive(below, 0xA405),
            focal_plane_px_per_mm=across / unit if across and unit else None,
            squeeze=squeeze,
            digital_zoom=max(_positive(below, 0xA404) or 1.0, 1.0),
            pixel_size=_size(below, (0xA002, 0xA003)) or size,
            lens_make=below.text(0xA433),
            lens_model=below.text(0xA434),
            f_number=_positive(below, 0x829D),
            exposure_s=_positive(below, 0x829A),
            iso=_positive(below, 0x8827),
        )


def _positive(directory: exif.Directory, tag: int) -> float | None:
    """Return the first number of a tag if it is finite and > 0."""
    numbers = directory.numbers(tag)
    return numbers[0] if numbers and math.isfinite(numbers[0]) and numbers[0] > 0 else None


def _size(directory: exif.Directory, tags: tuple[int, int]) -> tuple[int, int] | None:
    """Return a width and a height that two tags state."""
    width, height = (int(_positive(directory, tag) or 0) for tag in tags)
    return (width, height) if width and height else None


def _pair(directory: exif.Directory, tag: int) -> tuple[int, int] | None:
    """Return a width and a height that one tag states."""
    numbers = directory.numbers(tag)
    if len(numbers) != 2 or not all(math.isfinite(n) and n >= 1 for n in numbers):
        return None
    return int(numbers[0]), int(numbers[1])
