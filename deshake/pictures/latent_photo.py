"""The latent picture of an estimate, as a photo (Fig. 4).

An estimate works with gradients. The photo has the intensities whose gradients are nearest to
the estimated ones. It has sharp edges at the edges of the estimate, and is flat elsewhere. Its
brightness may drift from one part of the frame to another.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from deshake.formats.encoding import Encoding
from deshake.metadata.metadata import Metadata
from deshake.signal.luminance import luminance
from deshake.signal.poisson import poisson_image

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.formats.photo import Photo

__all__ = ["latent_photo"]


def latent_photo(
    photo: Photo,
    gradients: NDArray[np.float32],
    region: tuple[int, int, int, int] | None = None,
) -> Photo:
    """Turn the gradients of an estimate into a grey photo: 8 bits, sRGB, no metadata.

    Parameters
    ----------
    photo : Photo
        The photo of the estimate.
    gradients : (2, h, w) array
        Differences to the right and to the lower neighbour, in linear light.
    region : (x, y, width, height), optional
        The part of the photo that the estimate used, by default the whole. The result has the mean
        brightness of this part.

    Returns
    -------
    Photo
        Of h x w pixels.

    """
    height, width = photo.shape
    x, y, across, down = (0, 0, width, height) if region is None else region
    grey = luminance(photo.pixels[y : y + down, x : x + across])
    mean = float(grey.mean(dtype=np.float64))
    pixels = poisson_image(gradients[0], gradients[1], mean)
    return replace(
        photo,
        pixels=pixels,
        clipped=np.zeros(pixels.shape, bool),
        alpha=None,
        encoding=Encoding("PNG", grey=True),
        metadata=Metadata(),
    )
