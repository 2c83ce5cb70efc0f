"""The focal length in pixels: from options, EXIF, or the size of the camera's sensor.

The confidence of a focal length is the judged chance that it is right to within 5 %. It depends on
the source, and is not a measured frequency:

| source | confidence |
|---|---|
| `focal_px` or `focal_35mm` | 1 |
| FocalLengthIn35mmFilm | 0.9 |
| FocalLength with FocalPlaneXResolution | 0.85 |
| FocalLength with lensfun's crop factor, or with the sensor's size | 0.8 |
| nothing: a 50 mm equivalent is assumed | 0.1 |

If two sources agree to 5 %, the confidence is 0.95. If they differ by more than 15 %, it is
multiplied by 0.6. Four more factors lower it: 0.9 if EXIF does not state the original size, 0.7
for a crop, 0.4 to 0.5 if the whole frame is a guess, and 0.8 for a digital zoom.

References
----------
.. [1] CIPA DCG-001, Guideline for noting digital camera specifications in catalogs, 2005: the
   35 mm equivalent refers to the diagonal, 43.27 mm for 36 x 24 mm.

"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from deshake.errors import CalibrationError
from deshake.lens.lens_profiles import crop_factor
from deshake.lens.sensor_sizes import sensor_size
from deshake.lens.whole_frame import WholeFrame, whole_frame

if TYPE_CHECKING:
    from deshake.metadata.camera_tags import CameraTags
    from deshake.metadata.metadata import Metadata

__all__ = ["ASSUMED", "FULL_FRAME_DIAGONAL", "FocalLength", "assumed_focal_length", "focal_length"]

FULL_FRAME_DIAGONAL: Final = math.hypot(36, 24)
"""Diagonal of the 35 mm frame in millimetres, 43.27."""

ASSUMED: Final = "assumed: 50 mm-equivalent"
"""Source of the focal length that is assumed if no source states one."""

_ASSUMED_35MM: Final = 50.0  # mm on 35 mm film, where nothing is known
_RANGE: Final = (0.1, 100.0)  # sensible focal lengths, in diagonals of the picture
_HINT: Final = (
    "give the focal length with --focal-35mm MM (35 mm equivalent) or --focal-px PIXELS, or find "
    "it with calibrate --chessboard"
)
_SQUEEZED: Final = 0.05  # relative difference of the two axes' resolutions: more is an error
_AGREES: Final = 0.05  # relative difference: up to it, two sources agree
_DIFFERS: Final = 0.15  # relative difference: above it, two sources contradict each other
_BOTH: Final = 0.95  # confidence where two sources agree
_ZOOMED: Final = 0.8  # factor of the confidence for a digital zoom
_ROUNDED: Final = 0.5  # mm: rounding of 35 mm equivalents, which are whole numbers


@dataclass(frozen=True)
class FocalLength:
    """A focal length and where it comes from.

    Parameters
    ----------
    pixels : float
        The focal length in pixels of the photo.
    source : str
        The option or tag that states it, such as "EXIF FocalLengthIn35mmFilm = 35 mm".
    confidence : float
        Chance that it is right to within 5 %, by the table at the head of this module.
    notes : tuple of str
        What the user should know.
    considered : tuple of str
        All sources that were compared; the log shows them.
    frame : (float, float) or None
        Longer and shorter side of the whole frame in pixels of the photo; None: not known.

    """

    pixels: float
    source: str
    confidence: float = 1.0
    notes: tuple[str, ...] = ()
    considered: tuple[str, ...] = ()
    frame: tuple[float, float] | None = None


def focal_length(
    metadata: Metadata,
    height: int,
    width: int,
    *,
    focal_px: float | None = None,
    focal_35mm: float | None = None,
) -> FocalLength:
    """Return the focal length of a photo, from the options or its metadata.

    The sources, in this order: `focal_px`; `focal_35mm`; FocalLengthIn35mmFilm; FocalLength with
    the focal plane resolution; FocalLength with lensfun's crop factor, if lensfunpy is installed;
    FocalLength with the sensor's size. A tag with an absurd value is ignored. Equivalents are
    whole numbers: where the focal plane agrees within their rounding, its value is used.

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
        If an option is absurd (outside 0.1 to 100 diagonals of the photo), neither options nor
        metadata state a focal length, or an anamorphic lens squeezes the picture.

    """
    diagonal = math.hypot(height, width)
    if focal_px is not None:
        return _checked(FocalLength(focal_px, f"--focal-px {focal_px:g}"), diagonal)
    if focal_35mm is not None:
        pixels = focal_35mm * diagonal / FULL_FRAME_DIAGONAL
        return _checked(FocalLength(pixels, f"--focal-35mm {focal_35mm:g}"), diagonal)
    tags = metadata.tags()
    _refuse_anamorphic(tags)
    frame = whole_frame(tags, height, width, _full_size(tags))
    ways = [
        way
        for way in (_from_equivalent(tags, frame), _from_focal_plane(tags, frame))
        if way is not None and _is_sensible(way.pixels, diagonal)
    ]
    by_sensor = _from_sensor(tags, frame)
    if not ways:
        by_crop = _from_crop_factor(tags, frame)
        ways = [] if by_crop is None else [by_crop]
    ways += [] if by_sensor is None else [by_sensor]
    ways = [way for way in ways if _is_sensible(way.pixels, diagonal)]
    if ways:
        return _weighed(ways, tags, frame, diagonal)
    if tags.focal_mm is None:
        raise CalibrationError("no focal length in its metadata", hint=_HINT)
    camera = f"{tags.make} {tags.model}".strip() or "the camera"
    raise CalibrationError(
        f"its metadata have a focal length of {tags.focal_mm:g} mm, but the size of the sensor "
        f"of {camera} is not known",
        hint=_HINT,
    )


def assumed_focal_length(height: int, width: int) -> FocalLength:
    """Return the focal length that is assumed if no source states one: a 50 mm equivalent.

    It is long on purpose. With too long a focal length, rotations become translations, and most
    blur is nearly a translation. With too short a focal length, paths of rotations are bent.
    """
    pixels = _ASSUMED_35MM * math.hypot(height, width) / FULL_FRAME_DIAGONAL
    return FocalLength(pixels, ASSUMED, 0.1)


def _weighed(
    ways: list[FocalLength], tags: CameraTags, frame: WholeFrame, diagonal: float
) -> FocalLength:
    """Return the first focal length, with the confidence that all sources together give."""
    first, others = ways[0], ways[1:]
    film = FULL_FRAME_DIAGONAL / diagonal
    considered = [*([frame.reason] if frame.reason else [])]
    considered += [
        f"{way.source}: {way.pixels:.1f} pixels, {way.pixels * film:.1f} mm" for way in ways
    ]
    notes = [frame.note] if frame.note else []
    confidence, pixels, source = first.confidence, first.pixels, first.source
    gaps = [abs(other.pixels / first.pixels - 1) for other in others]
    if gaps and min(gaps) <= _AGREES:
        confidence = _BOTH
    elif gaps and min(gaps) > _DIFFERS:
        confidence *= 0.6
        notes.append(
            f"its metadata contradict each other: {first.pixels:.0f} pixels of focal length by "
            f"{first.source}, {others[0].pixels:.0f} by {others[0].source}"
        )
    if tags.focal_35mm and others and "FocalPlane" in others[0].source:
        rounding = _ROUNDED / tags.focal_35mm + 0.01
        if first.source.startswith("EXIF FocalLengthIn35mmFilm") and gaps[0] <= rounding:
            pixels, source = others[0].pixels, f"{first.source}, finer by FocalPlaneXResolution"
    if tags.digital_zoom > 1:
        confidence *= _ZOOMED
        considered.append(f"digital zoom {tags.digital_zoom:g}")
    confidence = round(confidence * frame.confidence, 3)
    whole = (frame.long, frame.short)
    return FocalLength(pixels, source, confidence, tuple(notes), tuple(considered), whole)


def _from_equivalent(tags: CameraTags, frame: WholeFrame) -> FocalLength | None:
    """Use the 35 mm equivalent and the diagonal of the original frame.

    Most cameras include a digital zoom in the equivalent. The sensor's size, if known, decides
    whether this one does.
    """
    if tags.focal_35mm is None:
        return None
    millimetres, source = tags.focal_35mm, f"EXIF FocalLengthIn35mmFilm = {tags.focal_35mm:g} mm"
    size = sensor_size(tags.make, tags.model)
    if tags.digital_zoom > 1 and size is not None and tags.focal_mm is not None:
        optical = tags.focal_mm * FULL_FRAME_DIAGONAL / math.hypot(*size)
        if abs(millimetres / optical - 1) < abs(millimetres / (optical * tags.digital_zoom) - 1):
            millimetres *= tags.digital_zoom
            source += f", digital zoom {tags.digital_zoom:g}"
    pixels = millimetres * math.hypot(frame.long, frame.short) / FULL_FRAME_DIAGONAL
    return FocalLength(pixels, source, 0.9)


def _from_focal_plane(tags: CameraTags, frame: WholeFrame) -> FocalLength | None:
    """Use the pixels per millimetre of the original picture, and the factor of later resizing."""
    if tags.focal_mm is None or tags.focal_plane_px_per_mm is None:
        return None
    pixels = tags.focal_mm * tags.focal_plane_px_per_mm * frame.scale * tags.digital_zoom
    return FocalLength(
        pixels,
        f"EXIF FocalLength = {tags.focal_mm:g} mm at "
        f"{tags.focal_plane_px_per_mm:.1f} pixels/mm (FocalPlaneXResolution)",
        0.85,
    )


def _from_crop_factor(tags: CameraTags, frame: WholeFrame) -> FocalLength | None:
    """Use lensfun's crop factor of the camera."""
    factor = None if tags.focal_mm is None else crop_factor(tags.make, tags.model)
    if tags.focal_mm is None or factor is None:
        return None
    pixels = tags.focal_mm * factor * math.hypot(frame.long, frame.short) / FULL_FRAME_DIAGONAL
    return FocalLength(
        pixels * tags.digital_zoom,
        f"EXIF FocalLength = {tags.focal_mm:g} mm, crop factor {factor:.4g} of {tags.model} "
        "(lensfun)",
        0.8,
    )


def _from_sensor(tags: CameraTags, frame: WholeFrame) -> FocalLength | None:
    """Use the sensor's size; a frame of another shape uses one side of the sensor in full."""
    size = sensor_size(tags.make, tags.model)
    if tags.focal_mm is None or size is None:
        return None
    pixels = tags.focal_mm * max(frame.long / size[0], frame.short / size[1])
    return FocalLength(
        pixels * tags.digital_zoom,
        f"EXIF FocalLength = {tags.focal_mm:g} mm on the {size[0]:g} x {size[1]:g} mm sensor "
        f"of {tags.model}",
        0.8,
    )


def _full_size(tags: CameraTags) -> tuple[float, float] | None:
    """Return the sensor's sides in pixels, by its size and the resolution of the focal plane."""
    size = sensor_size(tags.make, tags.model)
    if size is None or tags.focal_plane_px_per_mm is None:
        return None
    return size[0] * tags.focal_plane_px_per_mm, size[1] * tags.focal_plane_px_per_mm


def _refuse_anamorphic(tags: CameraTags) -> None:
    """Refuse pictures that have two focal lengths."""
    named = "anamorphic" in tags.lens_model.casefold()
    if named or abs(tags.squeeze - 1) > _SQUEEZED:
        what = f"its lens is {tags.lens_model}" if named else (
            f"its focal plane has {tags.squeeze:.2f} times as many pixels a millimetre down as "
            "across"
        )  # fmt: skip
        raise CalibrationError(
            f"{what}: the picture is squeezed, and has two focal lengths",
            hint="stretch it to its true proportions first, then give its focal length with "
            "--focal-35mm MM or --focal-px PIXELS",
        )


def _is_sensible(pixels: float, diagonal: float) -> bool:
    return math.isfinite(pixels) and _RANGE[0] * diagonal <= pixels <= _RANGE[1] * diagonal


def _checked(focal: FocalLength, diagonal: float) -> FocalLength:
    if _is_sensible(focal.pixels, diagonal):
        return focal
    raise CalibrationError(
        f"a focal length of {focal.pixels:g} pixels ({focal.source}) cannot be right for a photo "
        f"of {diagonal:.0f} pixels across",
        hint="35 mm equivalents lie between about 10 and 1000",
    )
