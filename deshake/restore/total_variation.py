"""Total variation of all colours together: the smoothness of pictures that have edges.

    TV(f) = sum lambda |D f|

D takes the differences of neighbours, down and across; |.| takes both of them and all colours as
one vector, so that edges agree among the colours and a grey picture stays grey.

References
----------
.. [1] A. Beck and M. Teboulle, "Fast gradient-based algorithms for constrained total variation
   image denoising and deblurring problems", IEEE Trans. Image Processing 18, 2009,
   https://doi.org/10.1109/TIP.2009.2028250

"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deshake.signal.noise import averaged_over_blur, mean_light, noise_model
from deshake.signal.shrinkage import lengths

__all__ = ["divergence", "gradient", "less_varied", "variation_weight"]

Image = NDArray[np.float32]

_TAU = 0.3  # weight of the total variation in units of the noise
_DARKEST = 0.03  # light that is added to the divisor: dark detail may look like noise
_LEAST = np.float32(1e-12)  # avoids division by 0
_SMALLEST = np.float32(0.1)  # least share of a pixel's light after smoothing


def gradient(f: Image) -> tuple[Image, Image]:
    """Differences of neighbours, down and across, (C, h, w) each; 0 in the last row or column."""
    down, across = np.zeros_like(f), np.zeros_like(f)
    np.subtract(f[:, 1:], f[:, :-1], out=down[:, :-1])
    np.subtract(f[..., 1:], f[..., :-1], out=across[..., :-1])
    return down, across


def divergence(down: Image, across: Image) -> Image:
    """Apply minus the transpose of `gradient` to fields (C, h, w)."""
    out = np.zeros_like(down)
    out[:, :-1] += down[:, :-1]
    out[:, 1:] -= down[:, :-1]
    out[..., :-1] += across[..., :-1]
    out[..., 1:] -= across[..., :-1]
    return out


def variation_weight(g: Image, margin: int) -> Image:
    """Weigh the variation by the noise: lambda = tau sigma / light.

    Where light x has noise of variance sigma^2, Richardson-Lucy weighs a residual r by r^2 / 2x and
    not by r^2 / 2 sigma^2. The factor sigma^2 / x corrects this. The variation has units of sigma,
    so that dark and bright parts are smoothed alike. The light is averaged over the reach of the
    blur.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo, linear light.
    margin : int
        Pixels by which latent images are larger on every side.

    Returns
    -------
    (h + 2 margin, w + 2 margin) array of float32
        lambda, > 0.

    """
    slope, floor = noise_model(g)
    light = averaged_over_blur(mean_light(g), margin)
    light += np.float32(_DARKEST)
    sigma = np.sqrt(np.float32(slope) * light + np.float32(floor))
    sigma *= np.float32(_TAU)
    sigma /= light
    return np.pad(sigma, margin, mode="edge")


def less_varied(u: Image, spread: Image, weight: Image, steps: int) -> Image:
    """Return an f that nearly minimises ``sum (f - u)^2 / (2 spread) + sum weight |D f|``.

    The dual problem has a vector p of length <= 1 at each pixel: f = u + spread div(weight p).
    Accelerated projected gradient steps solve it [1]. The step of each pixel is as long as its own
    spread allows. The result of a row depends on the rows at most `steps` + 1 away.

    Parameters
    ----------
    u : (C, h, w) array of float32
        A picture, >= 0.
    spread : (C, h, w) array of float32
        Variance of each pixel, >= 0: a larger one allows a larger change.
    weight : (h, w) array of float32
        Weight of the variation, > 0.
    steps : int
        Steps of the dual, >= 1: with one, small differences are smoothed as by diffusion.

    Returns
    -------
    (C, h, w) array of float32
        The picture f, >= 0.

    """
    most = spread.max(0)
    near = most.copy()
    np.maximum(near[:-1], most[1:], out=near[:-1])
    np.maximum(near[:, :-1], most[:, 1:], out=near[:, :-1])
    near += most
    near *= 4 * weight  # four differences meet at each end of a difference
    length = 1 / np.maximum(near, _LEAST)
    down, across = gradient(u)
    down *= length
    across *= length
    _project(down, across)
    momentum = 1.0
    ahead = down, across
    for _ in range(1, steps):
        slopes = gradient(_primal(u, spread, weight, *ahead))
        new_down, new_across = ahead[0] + length * slopes[0], ahead[1] + length * slopes[1]
        _project(new_down, new_across)
        following = (1 + np.sqrt(1 + 4 * momentum * momentum)) / 2
        further = np.float32((momentum - 1) / following)
        momentum = following
        ahead = new_down + further * (new_down - down), new_across + further * (new_across - across)
        down, across = new_down, new_across
    out: Image = np.maximum(_primal(u, spread, weight, down, across), _SMALLEST * u)
    return out


def _primal(u: Image, spread: Image, weight: Image, down: Image, across: Image) -> Image:
    """Return u + spread div(weight p)."""
    f = divergence(weight * down, weight * across)
    f *= spread
    f += u
    return f


def _project(down: Image, across: Image) -> None:
    """Shorten the vectors that are longer than 1."""
    n = np.maximum(lengths(down, across), 1)
    down /= n
    across /= n
