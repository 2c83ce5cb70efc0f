"""How to look past lights that clipped.

A lamp that outshines the sensor's range draws the path of the camera in white, and in the light
that spills over its edges the faintest error of the kernel, times the lamp, is stronger than all
that lies there. So the pixels that clipped, and in proportion those that the lamps reach, are not
trusted: m = 1 / (1 + (kappa A l)^2 / sigma^2), where l is the light above the clip level in a first
estimate. What lies behind the streaks is seen elsewhere, from other orientations of the camera: it
is found again from the trusted pixels alone, by Richardson-Lucy with weights,

    f <- f . (A^T(m g / A f) / A^T m)^a,

with a > 1, for speed, while the lamps and what no trusted pixel sees stay as the first estimate has
them. That lamps must not disturb their surroundings is the idea of Whyte, Sivic and Zisserman,
"Deblurring shaken and partially saturated images", IJCV 110, 2014,
https://doi.org/10.1007/s11263-014-0727-3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.operators.shake_blur import Filters

__all__ = ["behind_lights", "trust"]

Image = NDArray[np.float32]

_KAPPA = np.float32(0.1)  # how wrong the light of a lamp is taken to be, as a share of it
_LAMP = 1.5  # light above which a pixel is a lamp: noise and rings may exceed the clip level
_HASTE = np.float32(1.75)  # power of the factors: 3 iterations do the work of 6
_DARK = np.float32(1e-6)
_HIDDEN = 0.05  # share of trusted pixels below which a latent pixel is not seen
_DOUBT = 2.0  # how soon trusted pixels are believed instead of the first estimate
_FRAME_SEEN = np.float32(1e-2)


def trust(f: Image, blur: Filters, clipped: NDArray[np.bool_], variance: Image | float) -> Image:
    """Weigh the pixels of a photo with clipped lights.

    Parameters
    ----------
    f : (C, H, W) array of float32
        First estimate of the latent image, with lights above 1.
    blur : Filters
        The blur A.
    clipped : (h, w) array of bool
        Where the photo clipped.
    variance : (h, w) array of float32 or float
        Of the noise.

    Returns
    -------
    (h, w) array of float32
        The weights m, 0..1; 0 where a pixel or a neighbour of it clipped.

    """
    light = f.max(0)
    spilt = blur.forward(np.where(light > _LAMP, light, 0)[None])[0]
    m: Image = 1 / (1 + np.square(_KAPPA * spilt) / variance)
    m[binary_dilation(clipped, np.ones((3, 3), bool))] = 0
    return m


def behind_lights(
    f: Image,
    g: Image,
    blur: Filters,
    m: Image,
    *,
    iterations: int,
    progress: Callable[[float, str], None],
) -> None:
    """Find again what lies behind the streaks of lamps.

    Parameters
    ----------
    f : (C, H, W) array of float32
        First estimate of the latent image, with lights above 1; it is changed.
    g : (C, h, w) array of float32
        The photo, linear.
    blur : Filters
        The blur A.
    m : (h, w) array of float32
        Weights of the pixels, from `trust`.
    iterations : int
        Of the weighted Richardson-Lucy.
    progress : callable
        Told the fraction done, 0 to 1, and what is being done, after each iteration.

    """
    seen = blur.adjoint(m[None])[0]
    share = seen / np.maximum(blur.adjoint(np.ones_like(m)[None])[0], _FRAME_SEEN)
    kept = (share < _HIDDEN) | (f.max(0) > _LAMP)
    doubt = np.where(kept, 0, np.clip(_DOUBT * (1 - share), 0, 1)).astype(np.float32)
    np.maximum(seen, _DARK, out=seen)
    for c in range(len(f)):
        back = blur.adjoint((m * np.maximum(g[c], 0))[None])[0]
        back /= seen
        f[c] += doubt * (np.maximum(back, _DARK) - f[c])
    for done in range(1, iterations + 1):
        for c in range(len(f)):
            ratio = blur.forward(f[c : c + 1])
            np.divide(m * np.maximum(g[c], 0), np.maximum(ratio[0], _DARK), out=ratio[0])
            factor = blur.adjoint(ratio)[0]
            factor /= seen
            f[c] *= np.where(kept, 1, np.maximum(factor, 0) ** _HASTE)
        progress(done / iterations, f"deblurring behind lights, iteration {done}")
