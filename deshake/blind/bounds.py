"""The largest width of a blur: the bound from an angle, and the bound from the photo's size."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from deshake.blind.settings import SETTINGS
from deshake.errors import EstimationError
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from deshake.geometry.camera import Camera

__all__ = ["blur_bound", "check_size"]

_S: Final = SETTINGS.bounds


def blur_bound(camera: Camera, max_angle: float) -> float:
    """Return the bound of the blur, in pixels, for rotations of at most `max_angle` radians.

    The angle is measured from one end of the shake to the other, about any one axis.
    """
    return float((max_angle / grid_steps(camera)).max())


def check_size(height: int, width: int, bound: float) -> None:
    """Raise EstimationError if a photo is too small, or if a bound (px) does not fit it."""
    if min(height, width) < _S.smallest_photo:
        msg = f"{width}x{height} pixels are too few to estimate a shake from"
        hint = f"the shorter side must have at least {_S.smallest_photo} pixels"
        raise EstimationError(msg, hint=hint)
    if not 1 <= bound <= min(height, width) / 2:
        msg = f"a blur of {bound:.0f} px does not fit {width}x{height} pixels"
        hint = "give a --blur-size between 1 and half the shorter side"
        raise EstimationError(msg, hint=hint)
