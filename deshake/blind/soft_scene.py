"""The softness of a large photo, which an estimate takes for a part of the shake.

A large photo is never sharp to the pixel: the lens, the sensor and JPEG blur every edge a little.
The latent picture has sharper edges than that. So the kernel contains this blur, too. A path of a
few pixels then comes out as a band of several pixels, and a photo that is deblurred with it gets
rims and noise. A hand moves a camera along a path, so the width across the path is not its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.blind.camera_path import thinned
from deshake.blind.settings import SETTINGS
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from deshake.blind.entry import Entry
    from deshake.geometry.kernel import RotationKernel

__all__ = ["without_softness"]

_S: Final = SETTINGS.soft_scene


def without_softness(entry: Entry) -> RotationKernel:
    """Return the kernel of a narrow shake of a large photo without the softness of the photo.

    Other kernels remain as they are: those of smaller photos, which are sharper, those of wide
    shakes, of which the softness is a small part, and disks, which are no path.
    """
    kernel = entry.kernel
    extent = kernel.extent_px()
    large = np.prod(kernel.camera.shape) >= _S.least_pixels
    if not large or not 0 < extent <= _S.widest:
        return kernel
    least, most = _S.thickness
    is_band = least <= len(kernel.weights) / (extent / RATIO**entry.level) <= most
    return thinned(kernel) if is_band else kernel
