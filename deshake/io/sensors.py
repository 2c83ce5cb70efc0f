"""The focal length in pixels: from options, EXIF, or the size of the camera's sensor.

References
----------
.. [1] CIPA DCG-001, Guideline for noting digital camera specifications in catalogs, 2005: the
   35 mm equivalent goes by the diagonal, 43.27 mm for 36 x 24 mm.

"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from deshake.errors import CalibrationError

if TYPE_CHECKING:
    from deshake.io.metadata import CameraTags, Metadata

__all__ = ["FULL_FRAME_DIAGONAL", "FocalLength", "assumed_focal_length", "focal_length"]

FULL_FRAME_DIAGONAL: Final = math.hypot(36, 24)
"""Diagonal of the 35 mm frame in millimetres, 43.27."""

_ASSUMED_35MM: Final = 50.0
_RANGE: Final = (0.1, 100.0)  # sensible focal lengths, in diagonals of the picture
_SAME_SHAPE: Final = 0.02  # aspect ratios closer than this mean resized, not cropped
_HINT: Final = "give the focal length with --focal-35mm MM (35 mm equivalent) or --focal-px PIXELS"

# Width and height in millimetres of the sensors (as the makers' specifications give them) of
# well-known cameras that may write FocalLength alone. The names are EXIF's Model; they must match
# to the letter, but for case, since a near miss is often another sensor.
_SENSORS: Final[dict[tuple[float, float], tuple[str, ...]]] = {
    (36.0, 24.0): (
        "Canon EOS 5D Mark II", "Canon EOS 5D Mark III", "Canon EOS-1Ds Mark III",
        "Canon EOS-1D X", "Canon EOS R",
    ),
    (36.0, 23.9): ("NIKON D3", "NIKON D3S", "NIKON D700", "NIKON D4"),
    (35.9, 24.0): ("NIKON D600", "NIKON D610", "NIKON D750", "NIKON D800", "ILCE-7R"),
    (35.8, 23.9): ("Canon EOS 5D", "Canon EOS 6D", "ILCE-7"),
    (28.7, 19.1): ("Canon EOS-1D", "Canon EOS-1D Mark II", "Canon EOS-1D Mark II N"),
    (27.9, 18.6): ("Canon EOS-1D Mark IV",),
    (23.7, 15.6): ("NIKON D40", "NIKON D40X", "NIKON D50", "NIKON D70", "NIKON D70s", "NIKON D100"),
    (23.6, 15.8): (
        "NIKON D80", "NIKON D90", "NIKON D200", "NIKON D300", "NIKON D3000", "NIKON D5000",
        "NIKON D60", "FinePix X100", "PENTAX K-x",
    ),
    (23.6, 15.6): ("NIKON D7000", "NIKON D5100", "X-Pro1", "X-E1", "X-T1"),
    (23.5, 15.6): ("NIKON D7100", "NIKON D5300", "ILCE-6000", "NEX-6", "NEX-7"),
    (22.7, 15.1): (
        "Canon EOS 10D", "Canon EOS D30", "Canon EOS D60", "Canon EOS 300D DIGITAL",
        "Canon EOS DIGITAL REBEL",
    ),
    (22.5, 15.0): ("Canon EOS 20D", "Canon EOS 30D", "Canon EOS 70D"),
    (22.3, 14.9): (
        "Canon EOS 7D", "Canon EOS 50D", "Canon EOS 60D", "Canon EOS 500D", "Canon EOS 550D",
        "Canon EOS 600D", "Canon EOS 650D", "Canon EOS 700D", "Canon EOS M",
        "Canon EOS REBEL T1i", "Canon EOS REBEL T2i", "Canon EOS REBEL T3i", "Canon EOS REBEL T4i",
        "Canon EOS REBEL T5i",
    ),
    (22.2, 14.8): (
        "Canon EOS 40D", "Canon EOS 350D DIGITAL", "Canon EOS 400D DIGITAL", "Canon EOS 450D",
        "Canon EOS 1000D", "Canon EOS 1100D", "Canon EOS DIGITAL REBEL XT",
        "Canon EOS DIGITAL REBEL XTi", "Canon EOS DIGITAL REBEL XSi",
    ),
    (17.3, 13.0): (
        "E-1", "E-300", "E-330", "E-400", "E-410", "E-420", "E-500", "E-510", "E-520", "E-3",
        "E-P1", "E-P2", "E-PL1", "E-M5", "E-M10", "DMC-G1", "DMC-GF1",
    ),
    (13.2, 8.8): ("DSC-RX100", "DSC-RX100M2", "DSC-RX100M3", "Canon PowerShot G7 X"),
    (7.44, 5.58): ("Canon PowerShot G11", "Canon PowerShot G12", "Canon PowerShot S90",
                   "Canon PowerShot S95", "Canon PowerShot S100"),
    (5.76, 4.29): ("Canon DIGITAL IXUS 70", "Canon PowerShot SD1000", "Canon PowerShot A570 IS"),
}  # fmt: skip
_SENSOR_BY_MODEL: Final = {
    model.casefold(): size for size, models in _SENSORS.items() for model in models
}
_MAKES: Final = ("canon", "nikon", "olympus", "panasonic", "sony", "fujifilm", "pentax")


@dataclass(frozen=True)
class FocalLength:
    """A focal length and where it comes from.

    Parameters
    ----------
    pixels : float
        The focal length in pixels of the photo.
    source : str
        The option or tag that gave it, such as "EXIF FocalLengthIn35mmFilm = 35 mm".

    """

    pixels: float
    source: str


def focal_length(
    metadata: Metadata,
    height: int,
    width: int,
    *,
    focal_px: float | None = None,
    focal_35mm: float | None = None,
) -> FocalLength:
    """Tell the focal length of a photo.

    In this order: `focal_px`; `focal_35mm`; FocalLengthIn35mmFilm; FocalLength with the focal
    plane resolution; FocalLength with the sensor's size. A tag whose value is absurd is passed
    over.

    Parameters
    ----------
    metadata : Metadata
        The photo's metadata.
    height, width : int
        The photo's size in pixels, upright.
    focal_px : float, optional, keyword-only
        The focal length in pixels of this photo.
    focal_35mm : float, optional, keyword-only
        The focal length in millimetres that has the same diagonal angle of view on 36 x 24 mm.

    Raises
    ------
    CalibrationError
        If an option is absurd (outside 0.1 to 100 diagonals of the photo), or neither options
        nor metadata tell.

    """
    diagonal = math.hypot(height, width)
    if focal_px is not None:
        return _checked(FocalLength(focal_px, f"--focal-px {focal_px:g}"), diagonal)
    if focal_35mm is not None:
        pixels = focal_35mm * diagonal / FULL_FRAME_DIAGONAL
        return _checked(FocalLength(pixels, f"--focal-35mm {focal_35mm:g}"), diagonal)
    tags = metadata.tags()
    for found in (
        _from_equivalent(tags, height, width),
        _from_focal_plane(tags, height, width),
        _from_sensor(tags, height, width),
    ):
        if found is not None and _is_sensible(found.pixels, diagonal):
            return found
    if tags.focal_mm is None:
        raise CalibrationError("its metadata state no focal length", hint=_HINT)
    camera = f"{tags.make} {tags.model}".strip() or "the camera"
    raise CalibrationError(
        f"its metadata state a focal length of {tags.focal_mm:g} mm, but the size of the sensor "
        f"of {camera} is not known",
        hint=_HINT,
    )


def assumed_focal_length(height: int, width: int) -> FocalLength:
    """Return what is assumed where nothing tells: a 50 mm equivalent.

    Rather long than short: a focal length too long turns rotations into translations, which the
    blur mostly is; one too short bends them.
    """
    pixels = _ASSUMED_35MM * math.hypot(height, width) / FULL_FRAME_DIAGONAL
    return FocalLength(pixels, "assumed: 50 mm-equivalent")


def _from_equivalent(tags: CameraTags, height: int, width: int) -> FocalLength | None:
    """By the diagonal of the frame as it was taken."""
    if tags.focal_35mm is None:
        return None
    long, short = _frame(tags, height, width)
    pixels = tags.focal_35mm * math.hypot(long, short) / FULL_FRAME_DIAGONAL
    return FocalLength(pixels, f"EXIF FocalLengthIn35mmFilm = {tags.focal_35mm:g} mm")


def _from_focal_plane(tags: CameraTags, height: int, width: int) -> FocalLength | None:
    """By the pixels a millimetre of the picture as taken, and how much it was resized since."""
    if tags.focal_mm is None or tags.focal_plane_px_per_mm is None:
        return None
    scale = 1.0
    if tags.pixel_size is not None:
        scale = _frame(tags, height, width)[0] / max(tags.pixel_size)
    pixels = tags.focal_mm * tags.focal_plane_px_per_mm * scale
    return FocalLength(
        pixels,
        f"EXIF FocalLength = {tags.focal_mm:g} mm at "
        f"{tags.focal_plane_px_per_mm:.1f} pixels/mm (FocalPlaneXResolution)",
    )


def _from_sensor(tags: CameraTags, height: int, width: int) -> FocalLength | None:
    """By the sensor's size; a frame of another shape uses one of its sides in full."""
    make = tags.make.casefold()
    size = _SENSOR_BY_MODEL.get(tags.model.casefold())
    if tags.focal_mm is None or size is None or not make.startswith(_MAKES):
        return None
    long, short = _frame(tags, height, width)
    pixels = tags.focal_mm * max(long / size[0], short / size[1])
    return FocalLength(
        pixels,
        f"EXIF FocalLength = {tags.focal_mm:g} mm on the {size[0]:g} x {size[1]:g} mm sensor "
        f"of {tags.model}",
    )


def _frame(tags: CameraTags, height: int, width: int) -> tuple[int, int]:
    """Return the longer and shorter side of the whole frame, in pixels of the photo.

    That is the photo, unless EXIF states a larger picture of another shape: then the photo is
    taken to be a crop of it.
    """
    long, short = max(height, width), min(height, width)
    if tags.pixel_size is not None:
        whole, narrow = max(tags.pixel_size), min(tags.pixel_size)
        other_shape = abs(whole * short / (narrow * long) - 1) > _SAME_SHAPE
        if other_shape and whole >= long and narrow >= short:
            return whole, narrow
    return long, short


def _is_sensible(pixels: float, diagonal: float) -> bool:
    return math.isfinite(pixels) and _RANGE[0] * diagonal <= pixels <= _RANGE[1] * diagonal


def _checked(found: FocalLength, diagonal: float) -> FocalLength:
    if _is_sensible(found.pixels, diagonal):
        return found
    raise CalibrationError(
        f"{found.source} makes a focal length of {found.pixels:g} pixels, "
        f"for a photo of {diagonal:.0f} pixels across",
        hint="35 mm equivalents lie between about 10 and 1000",
    )
