"""EXIF, XMP and ICC as a photo holds them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from deshake.metadata import exif, exif_editing, xmp
from deshake.metadata.camera_tags import read_camera_tags

if TYPE_CHECKING:
    from deshake.metadata.camera_tags import CameraTags
    from deshake.metadata.density import Density

__all__ = ["Metadata"]


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

    def reduced(self, old: tuple[int, int], new: tuple[int, int]) -> Metadata:
        """Return the metadata of the photo reduced from one size to another, in EXIF and in XMP.

        Everything in pixels becomes smaller: the size of the picture, the resolution of the focal
        plane, the place of the subject. Sizes are heights and widths.
        """
        down, across = (less / more for less, more in zip(new, old, strict=True))
        return replace(
            self,
            exif=exif_editing.with_size(exif_editing.scaled(self.exif, across, down), *new),
            xmp=xmp.with_size(xmp.scaled(self.xmp, across, down), *new),
        )

    def tags(self) -> CameraTags:
        """Read the tags that calibration needs; odd values read as None."""
        return read_camera_tags(self.exif)
