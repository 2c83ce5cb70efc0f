"""The whole frame of a photo that was perhaps cropped or resized later.

A focal length in millimetres gives the angle of view of the whole frame. EXIF states the original
size of the picture. Where the file has another size, the picture was resized or cropped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from deshake.metadata.camera_tags import CameraTags

__all__ = ["WholeFrame", "whole_frame"]

_CLOSE: Final = 0.02  # relative difference of two sides: smaller ones are ignored
_SHAPES: Final = (1.0, 5 / 4, 4 / 3, 3 / 2, 16 / 9, 2.0, 20 / 9)  # aspect ratios of cameras
_RESIZED: Final = 1.25  # factor: people reduce a picture by more than this, or not at all
_QUARTER: Final = 0.25  # share of the area: a smaller crop is taken to be resized, too


@dataclass(frozen=True)
class WholeFrame:
    """The original frame, in pixels of the photo.

    Parameters
    ----------
    long, short : float
        Its longer and its shorter side.
    scale : float
        Pixels of the photo per pixel of the original picture.
    confidence : float
        The confidence, 0 to 1.
    note : str
        A note to the user; empty: none.
    reason : str
        Why this frame was chosen; the log shows it.

    """

    long: float
    short: float
    scale: float = 1.0
    confidence: float = 1.0
    note: str = ""
    reason: str = ""


def whole_frame(
    tags: CameraTags, height: int, width: int, full: tuple[float, float] | None = None
) -> WholeFrame:
    """Infer the whole frame of a photo.

    A picture of the original shape, within the rounding of its sides, was resized. A picture of
    another shape was cropped. If at least a quarter of the area is left, it was not resized. Else
    it was cropped as little as its shape allows, and resized. The photo may be turned by 90
    degrees.

    Parameters
    ----------
    tags : CameraTags
        The camera's tags.
    height, width : int
        The photo's size in pixels.
    full : (float, float), optional
        The sensor's longer and shorter side in pixels, from its size and the resolution of the
        focal plane. Programs that crop or resize often write the new size, but rarely change that
        resolution.

    """
    long, short = max(height, width), min(height, width)
    taken = None if tags.pixel_size is None else (max(tags.pixel_size), min(tags.pixel_size))
    if full is not None and (taken is None or full[0] > (1 + _CLOSE) * taken[0]):
        return _by_sensor(long, short, full)
    if taken is None:
        return _by_shape(long, short)
    if (long, short) == taken:
        return WholeFrame(long, short, reason=f"as taken, {long} x {short} pixels")
    scale = long / taken[0]
    if abs(taken[1] * scale - short) <= max(1.0, scale):
        return WholeFrame(
            long, short, scale, reason=f"{scale:.3g} times the size of what was taken"
        )
    left = long * short / (taken[0] * taken[1])
    return _cropped((long, short), taken, resized=left < _QUARTER)


def _by_sensor(long: int, short: int, full: tuple[float, float]) -> WholeFrame:
    """Infer the whole frame of a photo that has fewer pixels than its sensor."""
    same_shape = abs(full[0] * short / (full[1] * long) - 1) < _CLOSE
    if same_shape and full[0] > _RESIZED * long:
        return WholeFrame(long, short, long / full[0], 0.9, reason="resized, by its sensor")
    return _cropped((long, short), (round(full[0]), round(full[1])))


def _cropped(size: tuple[int, int], whole: tuple[int, int], *, resized: bool = False) -> WholeFrame:
    """Infer the whole frame of a photo of another shape."""
    if size[0] > (1 + _CLOSE) * whole[0] or size[1] > (1 + _CLOSE) * whole[1]:
        return WholeFrame(
            *size,
            size[0] / whole[0],
            0.4,
            f"it was taken as {whole[0]} x {whole[1]} pixels, and has {size[0]} x {size[1]}: it "
            "seems to be cropped and enlarged, and its focal length is a guess",
            "cropped and enlarged",
        )
    scale = max(size[0] / whole[0], size[1] / whole[1]) if resized else 1.0
    small = min(size[0] / whole[0], size[1] / whole[1])
    reason = f"cropped from {whole[0]} x {whole[1]} pixels"
    if small >= 1 - _CLOSE:
        return WholeFrame(*whole, reason=reason)
    note = f"it was taken as {whole[0]} x {whole[1]} pixels, and has {size[0]} x {size[1]}: "
    if scale == 1:
        note += "it is taken to be a crop out of the whole frame"
        return WholeFrame(*whole, confidence=0.7, note=note, reason=reason)
    note += "it is taken to be cropped and resized, and its focal length is a guess"
    return WholeFrame(
        whole[0] * scale,
        whole[1] * scale,
        scale,
        0.4,
        note,
        f"{reason}, {scale:.3g} times the size",
    )


def _by_shape(long: int, short: int) -> WholeFrame:
    """Infer the whole frame from the shape of the photo alone."""
    if any(abs(long / short / shape - 1) < _CLOSE for shape in _SHAPES):
        reason = "its EXIF does not say how large it was taken; its shape is a camera's"
        return WholeFrame(long, short, confidence=0.9, reason=reason)
    note = (
        f"its EXIF does not say how large it was taken, and {long} x {short} is the shape of no "
        "camera: if it is cropped, the focal length that is assumed is too short"
    )
    return WholeFrame(long, short, confidence=0.5, note=note, reason="of no camera's shape")
