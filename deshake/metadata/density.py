"""The density of a photo, in pixels an inch: printers and layout programs read it.

EXIF and TIFF hold it in tags, JPEG also in its JFIF header, PNG in its chunk pHYs.

References
----------
.. [1] ITU-T T.871, JPEG File Interchange Format, 2011.
.. [2] Portable Network Graphics (PNG) Specification, third edition, W3C, 2025.

"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

from deshake.metadata import exif

if TYPE_CHECKING:
    from deshake.metadata.exif import Values

__all__ = ["ACROSS", "Density", "exif_density", "jfif_density", "phys_density"]

Unit = Literal["", "inch", "cm", "m"]

ACROSS: Final = 282
"""The tag XResolution."""

_DOWN: Final = 283
_UNIT: Final = 296
_METRES: Final[dict[Unit, float]] = {"inch": 0.0254, "cm": 0.01, "m": 1.0}
_JFIF_UNITS: Final[tuple[Unit, ...]] = ("", "inch", "cm")
_EXIF_UNITS: Final[dict[float, Unit]] = {1: "", 2: "inch", 3: "cm"}
_MOST: Final = 0xFFFF  # in a JFIF header
_FINE: Final = 1000  # the denominator in tags
_JFIF_AT: Final = 13  # where the unit lies in a JPEG that begins with a JFIF header
_JFIF: Final = b"JFIF\0"


class Density(NamedTuple):
    """Pixels a unit of length; without a unit, only the shape of a pixel.

    Parameters
    ----------
    across, down : float
        Above 0.
    unit : {"", "inch", "cm", "m"}
        The unit.

    """

    across: float
    down: float
    unit: Unit = "inch"

    def per(self, unit: Unit) -> Density:
        """Return the density in another unit of length.

        PNG states whole pixels a metre, so 300 pixels an inch are 11811 there, and 300 again here.
        """
        if self.unit == unit or not self.unit:
            return self
        factor = _METRES[unit] / _METRES[self.unit]
        sides = [side * factor for side in (self.across, self.down)]
        if self.unit == "m":
            known = zip((self.across, self.down), sides, strict=True)
            sides = [
                round(side) if round(round(side) / factor) == stored else side
                for stored, side in known
            ]
        return Density(sides[0], sides[1], unit)

    def in_jfif(self, data: bytes) -> bytes:
        """Return a JPEG whose JFIF header, if it begins with one, states this density."""
        density = self if self.unit in _JFIF_UNITS else self.per("inch")
        across, down = round(density.across), round(density.down)
        if data[6:11] != _JFIF or not (1 <= across <= _MOST and 1 <= down <= _MOST):
            return data
        head = struct.pack(">BHH", _JFIF_UNITS.index(density.unit), across, down)
        return data[:_JFIF_AT] + head + data[_JFIF_AT + len(head) :]

    def phys(self) -> bytes:
        """Return the content of a PNG's chunk pHYs; empty if it does not fit there."""
        density = self.per("m")
        across, down = round(density.across), round(density.down)
        if not (1 <= across < 1 << 31 and 1 <= down < 1 << 31):
            return b""
        return struct.pack(">IIB", across, down, bool(density.unit))

    def tags(self, order: str) -> Values:
        """Return the tags of EXIF and TIFF that state it, in a byte order."""
        density = self.per("inch") if self.unit == "m" else self
        sides = [min(round(_FINE * side), 0xFFFFFFFF) for side in (density.across, density.down)]
        unit = next(number for number, name in _EXIF_UNITS.items() if name == density.unit)
        return {
            ACROSS: (5, 1, struct.pack(f"{order}II", sides[0], _FINE)),
            _DOWN: (5, 1, struct.pack(f"{order}II", sides[1], _FINE)),
            _UNIT: (3, 1, struct.pack(f"{order}H", unit)),
        }


def jfif_density(content: bytes) -> Density | None:
    """Read the density in a JFIF segment; None if it only states that pixels are square."""
    if not content.startswith(_JFIF) or len(content) < len(_JFIF) + 7:
        return None
    unit, across, down = struct.unpack_from(">BHH", content, len(_JFIF) + 2)
    if unit >= len(_JFIF_UNITS) or not across or not down or (unit == 0 and across == down):
        return None
    return Density(across, down, _JFIF_UNITS[unit])


def phys_density(content: bytes) -> Density | None:
    """Read the density in a PNG's chunk pHYs; None if it only states square pixels, or is wrong."""
    if len(content) != 9:
        return None
    across, down, unit = struct.unpack(">IIB", content)
    if not across or not down or unit > 1 or (unit == 0 and across == down):
        return None
    return Density(across, down, "m" if unit else "")


def exif_density(block: bytes) -> Density | None:
    """Read the density in the tags of an EXIF block; None if it is missing or impossible."""
    first = exif.read_first(block)
    if first is None:
        return None
    sides = [first.numbers(tag)[:1] or [math.nan] for tag in (ACROSS, _DOWN)]
    unit = _EXIF_UNITS.get((first.numbers(_UNIT)[:1] or [2])[0])
    across, down = sides[0][0], sides[1][0]
    if unit is None or not (0 < across < math.inf and 0 < down < math.inf):
        return None
    return Density(across, down, unit)
