"""The tone curve that cameras commonly apply to the light, and the light before it.

A camera brightens the middle tones of its JPEGs and makes them steeper, and flattens the darkest
and the brightest ones. The file states the curve from its values to light, and not this one. Every
camera has one of its own. With v the root of the light, this one is

    v -> S(v^p),   S(u) = (1 - c) u + c u^2 (3 - 2 u),   p = 1 - 0.12 s, c = 0.55 s

p brightens the middle, and c makes it steeper. The strength s is 1; with a lower one the curve is
nearer to none. Above white it goes on as a straight line. A blur is linear before the curve, not
behind it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.formats.transfer import LINEAR, display_values, linear_light

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.formats.transfer import Transfer

__all__ = ["CameraCurve", "light_before", "light_behind"]

_BRIGHTER: Final = 0.12
_STEEPER: Final = 0.55


@dataclass(frozen=True)
class CameraCurve:
    """The curve of a file whose light a camera's tone curve has changed.

    Parameters
    ----------
    transfer : Transfer
        The curve that the file states.
    strength : float
        That of the camera's curve, above 0 and at most 1.

    """

    transfer: Transfer
    strength: float = 1.0

    @property
    def name(self) -> str:
        """The curve's name."""
        return f"{self.transfer.name} and a camera's tone curve"

    def to_linear(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map code values in [0, 1] to linear light before the tone curve, in [0, 1]."""
        p, c = self._power_and_contrast
        slope = 1 + c / 2  # of S in the middle
        radius = (slope / (6 * c)) ** 0.5
        shown = np.sqrt(self.transfer.to_linear(values))
        below = np.minimum(shown, 1)
        # the root of a cubic, by thirds of an angle
        angle = np.arcsin((below - 0.5) * (1.5 / (radius * slope))) / 3
        even = 0.5 + 2 * radius * np.sin(angle) + (shown - below) / (1 - c)
        light: NDArray[np.float64] = np.maximum(even, 0) ** (2 / p)
        return light

    def from_linear(self, light: NDArray[np.float32]) -> NDArray[np.floating]:
        """Map linear light before the tone curve, in [0, 1], to code values in [0, 1]."""
        p, c = self._power_and_contrast
        even = light ** np.float32(p / 2)
        below = np.minimum(even, 1)
        shown = (1 - c) * even + c * below**2 * (3 - 2 * below)
        return self.transfer.from_linear(np.square(shown).astype(np.float32, copy=False))

    @property
    def _power_and_contrast(self) -> tuple[float, float]:
        """The numbers p and c of the curve."""
        return 1 - _BRIGHTER * self.strength, _STEEPER * self.strength


def light_before(light: NDArray[np.floating], strength: float = 1.0) -> NDArray[np.float32]:
    """Return the light before a camera's tone curve of some strength, from that behind it.

    1 is white, and both may exceed it.
    """
    return linear_light(light, CameraCurve(LINEAR, strength))


def light_behind(light: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the light behind a camera's tone curve, from that before it: undo `light_before`."""
    return display_values(light, CameraCurve(LINEAR))
