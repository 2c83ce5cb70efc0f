"""The noise of a short exposure, estimated with a registered long exposure of the same scene.

In one photo alone, noise and texture look alike, and its flattest parts are those where the noise
happens to be weak. The blurred photo has independent, faint noise. It shows where the scene is
flat, and how bright it is there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter

from deshake.operators.planes import channels_first
from deshake.signal.noise import mean_light, noise_line, pair_means

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Image = NDArray[np.float32]

__all__ = ["fitted_noise", "noise_of_pair"]

_LEVELS = 12  # levels of brightness
_FLAT = 0.3  # share of each level's samples that is used: the flattest
_FEWEST = 64  # usable samples: with fewer, the result is the least variance
_MEDIAN = 0.4549  # median of the squares of standard normal numbers
_FLATNESS_PX = 5  # means of 2 x 2 pixels: side of the window that measures flatness
_LEAST = 1e-8  # least variance


def noise_of_pair(f_N: Image, g: Image, valid: Image) -> tuple[float, float]:
    """Estimate how the variance of noise in f_N grows with the light: ``slope x + floor``.

    The noise is that of means of 2 x 2 pixels, times four. Interpolation and compression, which
    remove the finest noise, change it little.

    Parameters
    ----------
    f_N : (h, w) or (h, w, C) array of float32
        The noisy photo, registered, as bright as the blurred one.
    g : (h, w) or (h, w, C) array of float32
        The blurred photo, linear light.
    valid : (h, w) array of float32
        Weights of the pixels of f_N, 0..1.

    Returns
    -------
    slope, floor : float
        In squared shares of the clip level, slope >= 0, floor > 0; the mean over the colours.

    """
    light = pair_means(mean_light(g))
    rows, columns = (
        np.gradient(uniform_filter(light, 3)) if min(light.shape) > 1 else (light, light)
    )
    uneven = uniform_filter(np.square(rows) + np.square(columns), _FLATNESS_PX)
    usable = uniform_filter(pair_means(valid), 5)[:-1, :-1] > 1 - 1e-4
    squares: list[Image] = []
    for plane in channels_first(f_N):
        means = pair_means(plane)
        across = means[:, 1:] - means[:, :-1]
        squares.append(np.square(across[1:] - across[:-1])[usable])
    level, flat = light[:-1, :-1][usable], uneven[:-1, :-1][usable]
    if len(level) < _FEWEST:
        return 0.0, _LEAST
    order = np.argsort(level, kind="stable")
    levels, variances = [], []
    for part in np.array_split(order, _LEVELS):
        chosen = part[np.argsort(flat[part], kind="stable")[: max(int(_FLAT * len(part)), 1)]]
        levels.append(float(level[chosen].mean()))
        variances.append(np.mean([np.median(some[chosen]) for some in squares]) / _MEDIAN)
    return noise_line(np.array(levels), np.array(variances), _LEAST)


def fitted_noise(light: Image, variance: Image) -> tuple[float, float]:
    """Fit ``slope x + floor`` to variances of noise that are known at some lights x.

    Parameters
    ----------
    light, variance : (n,) arrays of float32
        Light of some pixels and variance of the noise there; n > 0.

    Returns
    -------
    slope, floor : float
        Slope >= 0, floor > 0. They minimise the relative errors over parts of equal count.

    """
    parts = np.array_split(np.argsort(light, kind="stable"), min(_LEVELS, light.size))
    levels = np.array([light[part].mean(dtype=np.float64) for part in parts])
    means = np.array([variance[part].mean(dtype=np.float64) for part in parts])
    return noise_line(np.maximum(levels, 0), means, _LEAST)
