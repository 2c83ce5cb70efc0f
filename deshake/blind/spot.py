"""Whether a kernel is a small round spot: a lens a little soft, not a camera that turned."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deshake.blind.trimming import heaviest
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel

__all__ = ["axes_px", "is_spot"]

_SMALL = 1.3  # px, standard deviation along the longer axis
_ROUND = 0.6  # shorter axis over the longer one
_FAINT = 0.2  # of the weight, that does not count
_POINT = 0.7  # px: so small a kernel is a point, whatever its shape


def axes_px(kernel: RotationKernel) -> tuple[float, float]:
    """Standard deviations of a kernel about X and Y along its longer and its shorter axis, px."""
    moved = (kernel.theta / grid_steps(kernel.camera))[:, :2]
    spread = np.cov(moved.T, aweights=kernel.weights, ddof=0)
    shorter, longer = np.sqrt(np.maximum(np.linalg.eigvalsh(spread), 0))
    return float(longer), float(shorter)


def is_spot(kernel: RotationKernel) -> bool:
    """Tell whether a kernel is a small round spot, in pixels of its camera's photo.

    Sharp and soft photos leave spots of 0 to 1.3 px; of 43 simulated hand shakes from 3 px on, none
    does from both of the two finest starts.
    """
    longer, shorter = axes_px(heaviest(kernel, _FAINT))
    return longer <= _POINT or (longer <= _SMALL and shorter >= _ROUND * longer)
