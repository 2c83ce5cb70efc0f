"""The test for a small round spot: the kernel of a soft lens, not of a shaken camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.settings import SETTINGS
from deshake.blind.trimming import heaviest
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel

__all__ = ["axes_px", "is_spot"]

_S: Final = SETTINGS.spot


def axes_px(kernel: RotationKernel) -> tuple[float, float]:
    """Return the standard deviations (px) of the rotations about X and Y, longer axis first."""
    moved = (kernel.theta / grid_steps(kernel.camera))[:, :2]
    spread = np.cov(moved.T, aweights=kernel.weights, ddof=0)
    shorter, longer = np.sqrt(np.maximum(np.linalg.eigvalsh(spread), 0))
    return float(longer), float(shorter)


def is_spot(kernel: RotationKernel) -> bool:
    """Return whether a kernel is a small round spot, in pixels of its camera's photo."""
    longer, shorter = axes_px(heaviest(kernel, _S.faint))
    return longer <= _S.point or (longer <= _S.small and shorter >= _S.roundness * longer)
