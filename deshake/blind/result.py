"""The result of a blind estimate: a kernel and its confidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from deshake.blind.variational.scales import ScaleReport
    from deshake.geometry.kernel import RotationKernel
    from deshake.signal.pyramid import ToneName

__all__ = ["BlindEstimate"]

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class BlindEstimate:
    """A blur kernel and its confidence.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel, for the camera of the whole photo.
    confidence : float
        The confidence, 0..1. From edges it is the estimated chance that the kernel improves the
        photo. From the variational inference it is the agreement of the last two scales: the cosine
        between their kernels, times the share of the weight that lies off the bounds. That value is
        not calibrated.
    notes : list of str
        Notes for the user, in plain words.
    scales : list of ScaleReport
        Reports of the scales, from coarse to fine.
    latent : (2, h, w) array of float32
        Gradients of the sharp photo, or of the region: differences to the right and to the lower
        neighbour, in linear light, at the size of the last scale, in the kernel's frame.
    name : str
        Name of the estimate.
    zoom : float
        Focal length of the kernel's camera over that of the camera that was given; not 1 only if
        the focal length was estimated.
    tones : {"linear light", "display values", "light before a tone curve"}
        What of the photo the kernel was estimated from.
    streaks : (T, 4) array of float64
        Places of the streaks of lights that the kernel was read from: x, y, width and height in
        pixels of the photo. None unless it was read from streaks.

    """

    kernel: RotationKernel
    confidence: float
    notes: list[str]
    scales: list[ScaleReport]
    latent: Image
    name: str = "variational"
    zoom: float = 1.0
    tones: ToneName = "linear light"
    streaks: NDArray[np.float64] | None = None
