"""The result of every method, and the check of its input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel

__all__ = ["Restoration", "check_photo"]

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Restoration:
    """A restored photo.

    Parameters
    ----------
    pixels : (h, w[, C]) array of float32
        Linear light, >= 0; lights that had clipped exceed 1.
    iterations : int
        Number of iterations.
    residual : float
        Root mean square residual of the unclipped pixels, in shares of the clip level, at the
        last iteration.

    """

    pixels: Image
    iterations: int
    residual: float


def check_photo(
    g: Image, kernel: RotationKernel, clipped: NDArray[np.bool_] | None, iterations: int | None
) -> None:
    """Refuse input that cannot be deblurred.

    Raises
    ------
    ValueError
        If the photo is not finite or does not fit the kernel's camera or the clipped pixels, or
        the iterations are fewer than 1.

    """
    shape = kernel.camera.shape
    if g.ndim not in {2, 3} or g.shape[:2] != shape:
        raise ValueError(f"a photo of shape {g.shape} does not fit a kernel for {shape}")
    if clipped is not None and clipped.shape != shape:
        raise ValueError(f"clipped pixels of shape {clipped.shape} do not fit a photo of {shape}")
    if not (np.isfinite(g.min()) and np.isfinite(g.max())):
        raise ValueError("a photo's pixels are finite")
    if iterations is not None and iterations < 1:
        raise ValueError("at least one iteration is needed")
