"""EXIF, XMP and ICC as a photo carries them, and the few tags that calibration needs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from deshake.io import exif, exif_editing, xmp

__all__ = ["CameraTags", "Metadata"]

_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # FocalPlaneResolutionUnit; 4, 5 are in use


@dataclass(frozen=True)
class CameraTags:
    """What the camera says about itself and the exposure; None where it says nothing sensible.

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
    pixel_size : (int, int) or None
        PixelXDimension and PixelYDimension: width and height of the picture as it was taken.
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
    pixel_size: tuple[int, int] | None = None
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

    """

    exif: bytes = b""
    xmp: bytes = b""
    icc: bytes = b""

    @property
    def orientation(self) -> int:
        """The EXIF orientation, 1 to 8."""
        return exif.orientation(self.exif)

    def upright(self) -> Metadata:
        """Return the metadata of the photo turned upright: orientation 1, in EXIF and in XMP.

        The EXIF thumbnail, which would lie on its side, is unlinked. Nothing else changes, and
        nothing at all if the orientation is 1 already.
        """
        if self.orientation == 1:
            return self
        return replace(self, exif=exif_editing.upright(self.exif), xmp=xmp.upright(self.xmp))

    def tags(self) -> CameraTags:
        """Read the tags that calibration needs; odd values read as None."""
        main = exif.read_first(self.exif)
        if main is None:
            return CameraTags()
        camera = CameraTags(make=main.text(0x010F), model=main.text(0x0110))
        below = exif.read_below(self.exif, main, exif.EXIF_POINTER)
        if below is None:
            return camera
        width, height = _positive(below, 0xA002), _positive(below, 0xA003)
        across = _positive(below, 0xA20E) or _positive(below, 0xA20F)
        unit = _MM_PER_UNIT.get(int(_positive(below, 0xA210) or 2))
        return replace(
            camera,
            focal_mm=_positive(below, 0x920A),
            focal_35mm=_positive(below, 0xA405),
            focal_plane_px_per_mm=across / unit if across and unit else None,
            pixel_size=(int(width), int(height)) if width and height else None,
            exposure_s=_positive(below, 0x829A),
            iso=_positive(below, 0x8827),
        )


def _positive(directory: exif.Directory, tag: int) -> float | None:
    """Return the first number of a tag if it is finite and > 0."""
    numbers = directory.numbers(tag)
    return numbers[0] if numbers and math.isfinite(numbers[0]) and numbers[0] > 0 else None
