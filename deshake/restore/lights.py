"""Weights of pixels near clipped lights, and restoration of the scene behind their streaks.

A lamp brighter than the sensor's range draws the path of the camera in white. Near it, even a
small error of the kernel, times the light of the lamp, is larger than the light of the scene.
So clipped pixels have no weight, and a pixel has less the more light of lamps reaches it:
m = 1 / (1 + (kappa A l)^2 / sigma^2), where l is the light above the clip level in a first
estimate. Other pixels, from other orientations of the camera, show the scene behind the streaks.
Richardson-Lucy restores it from the trusted pixels alone, by their weights,

    f <- f . (A^T(m g / A f) / A^T m)^a,

where a > 1 saves iterations. The factors come from the mean of the colours, and hold for all of
them. Only latent pixels that an untrusted pixel shows, too, are restored so. The lamps, and latent
pixels that no trusted pixel shows, keep the first estimate. Whyte, Sivic and Zisserman, "Deblurring
shaken and partially saturated images", IJCV 110, 2014,
https://doi.org/10.1007/s11263-014-0727-3, have the idea that lamps must not disturb their
surroundings.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from deshake.operators.planes import mean_plane
from deshake.signal.noise import mean_light

if TYPE_CHECKING:
    from deshake.operators.shake_blur import Filters
    from deshake.run import Run

__all__ = ["behind_lights", "trust"]

Image = NDArray[np.float32]

_KAPPA = np.float32(0.1)  # assumed error of the light of a lamp, as a share of it
_LAMP = 1.5  # light: a brighter pixel is a lamp; noise and rings may exceed the clip level
_POWER = np.float32(1.75)  # power a of the factors: 3 iterations do the work of 6
_DARK = np.float32(1e-6)  # least divisor
_HIDDEN = 0.05  # share of trusted pixels: with less, a latent pixel keeps the first estimate
_DOUBT = 2.0  # weight of the new estimate per share of untrusted pixels; the weight is at most 1
_FRAME_COVERED = np.float32(1e-2)  # A^T 1: least divisor
_TRUSTED = 0.98  # weight: a pixel with more counts as trusted
_SHOWN = 1e-3  # share of untrusted pixels: with less, a latent pixel keeps the first estimate


def trust(f: Image, blur: Filters, clipped: NDArray[np.bool_], variance: Image | float) -> Image:
    """Return weights of the pixels of a photo with clipped lights.

    Parameters
    ----------
    f : (C, H, W) array of float32
        First estimate of the latent image, with lights above 1.
    blur : Filters
        The blur A.
    clipped : (h, w) array of bool
        Clipped pixels of the photo.
    variance : (h, w) array of float32 or float
        Variance of the noise.

    Returns
    -------
    (h, w) array of float32
        The weights m, 0..1; 0 where a pixel or a neighbour of it clipped.

    """
    light = f.max(0)
    lamps = light > _LAMP
    spilt = blur.near(lamps).forward(np.where(lamps, light, 0)[None])[0]
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
    run: Run,
) -> None:
    """Restore the scene behind the streaks of lamps.

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
        Number of iterations of the weighted Richardson-Lucy.
    run : Run
        Receives the progress.

    """
    margin = (f.shape[1] - len(m)) // 2
    untrusted = m < _TRUSTED
    seeing = blur.near(np.pad(untrusted, margin))
    shown = seeing.adjoint(untrusted[None].astype(np.float32))[0] > _SHOWN
    local = blur.near(shown)
    y, x = np.nonzero(shown)  # mostly few pixels of a large photo
    coverage = local.adjoint(m[None])[0, y, x]
    share = coverage / np.maximum(local.adjoint(np.ones_like(m)[None])[0, y, x], _FRAME_COVERED)
    kept = (share >= _HIDDEN) & (f[:, y, x].max(0) <= _LAMP)
    behind = y[kept], x[kept]
    covered = np.maximum(coverage[kept], _DARK)
    doubt = np.clip(_DOUBT * (1 - share[kept]), 0, 1)
    for c in range(len(f)):
        back = local.adjoint((m * np.maximum(g[c], 0))[None])[0][behind]
        back /= covered
        f[c][behind] += doubt * (np.maximum(back, _DARK) - f[c][behind])
    light, photo = mean_plane(f), mean_light(np.moveaxis(g, 0, -1))
    first = light[behind]
    for done in range(1, iterations + 1):
        ratio = local.forward(light[None])[0]
        np.divide(m * photo, np.maximum(ratio, _DARK), out=ratio)
        factor = local.adjoint(ratio[None])[0][behind]
        factor /= covered
        light[behind] *= np.maximum(factor, 0) ** _POWER
        run.report(done / iterations, f"deblurring behind lights, iteration {done}")
    f[:, behind[0], behind[1]] *= light[behind] / np.maximum(first, _DARK)
