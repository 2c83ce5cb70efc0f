"""What a blind estimate returns: a kernel, and how far to trust it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from deshake.blind.variational.scales import ScaleReport
    from deshake.geometry.kernel import RotationKernel

__all__ = ["BlindEstimate"]

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class BlindEstimate:
    """A blur kernel and how far to trust it.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel, for the camera of the whole photo.
    confidence : float
        Agreement of the last two scales, 0..1: the cosine between their kernels, less the weight
        that lies on the bounds. It is not calibrated against known truth.
    notes : list of str
        What the user should know, in plain words.
    scales : list of ScaleReport
        From coarse to fine.
    latent : (2, h, w) array of float32
        The sharp photo's gradients, or the region's: differences to the right and to the lower
        neighbour, in linear light, at the size last worked on, in the kernel's frame.
    name : str
        What estimated it.

    """

    kernel: RotationKernel
    confidence: float
    notes: list[str]
    scales: list[ScaleReport]
    latent: Image
    name: str = "variational"
