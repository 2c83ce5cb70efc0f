"""Kernels that are narrower across the path than an estimate is.

A photo hardly says how wide a kernel is across its path. The softness of the scene, its noise and
the errors of the sharp picture all make an estimate wider there. A hand moves the camera along a
path without any width. So of all kernels that explain the photo about as well, the narrowest one is
nearest to the truth.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.settings import SETTINGS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel

__all__ = ["narrower", "narrowest"]

_S: Final = SETTINGS.narrowing


def narrower(kernel: RotationKernel) -> list[RotationKernel]:
    """Return kernels that are narrower across the longest axis, the widest first; all centred.

    The longest axis is that along which the rotations differ most, in grid steps. All distances
    from the line through the centroid along that axis become smaller by the same factor. No kernel
    becomes narrower than a thin path is on a grid.
    """
    places = (kernel.theta - kernel.centroid) / kernel.steps
    squares, axes = np.linalg.eigh(np.einsum("k,ki,kj->ij", kernel.weights, places, places))
    on_axis = np.outer(places @ axes[:, -1], axes[:, -1])
    width = max(squares[-2], 0.0) ** 0.5
    return [
        _moved(kernel, on_axis + share * (places - on_axis))
        for share in _S.shares
        if share * width >= _S.least_width
    ]


def narrowest(worths: NDArray[np.float64]) -> int:
    """Return the number of the narrowest kernel that is worth about as much as the best one.

    Parameters
    ----------
    worths : (n,) array
        What kernels are worth, the widest first; higher is better.

    """
    return int(np.flatnonzero(worths >= worths.max() - _S.tolerance)[-1])


def _moved(kernel: RotationKernel, places: NDArray[np.float64]) -> RotationKernel:
    """Move the rotations of a kernel to places in grid steps; no new axis begins to turn."""
    turns = np.ptp(kernel.theta, axis=0) > 0
    return replace(kernel, theta=places * turns * kernel.steps).resampled(kernel.steps)
