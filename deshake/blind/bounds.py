"""How wide a blur may be: what an angle allows, and what a photo has room for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deshake.errors import EstimationError
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from deshake.geometry.camera import Camera

__all__ = ["blur_bound", "check_size"]

_SMALLEST_PHOTO = 48  # px, shorter side


def blur_bound(camera: Camera, max_angle: float) -> float:
    """Bound of the blur, in pixels of the photo, of turns by at most `max_angle` radians.

    The angle is the largest from one end of the shake to the other, about any axis.
    """
    return float((max_angle / grid_steps(camera)).max())


def check_size(height: int, width: int, bound: float) -> None:
    """Raise EstimationError where a photo is too small, or a bound (px) does not fit it."""
    if min(height, width) < _SMALLEST_PHOTO:
        msg = f"{width}x{height} pixels are too few to estimate a blur kernel from"
        hint = f"the shorter side must have at least {_SMALLEST_PHOTO} pixels"
        raise EstimationError(msg, hint=hint)
    if not 1 <= bound <= min(height, width) / 2:
        msg = f"a blur of {bound:.0f} px does not fit {width}x{height} pixels"
        hint = "give a --blur-size between 1 and half the shorter side"
        raise EstimationError(msg, hint=hint)
