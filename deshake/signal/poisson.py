"""A picture from its gradients: the Poisson equation with free borders.

Estimated gradients belong to no picture: along different paths from pixel to pixel they have
different sums. The picture f whose gradients are nearest to them in least squares,

    min_f  sum (D_x f - g_x)^2 + (D_y f - g_y)^2

solves ``(D_x' D_x + D_y' D_y) f = D_x' g_x + D_y' g_y``, which the discrete cosine transform makes
diagonal (Simchony, Chellappa & Shao, "Direct analytical methods for solving Poisson equations in
computer vision problems", PAMI 1990). Its mean is free.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.fft import dctn, idctn

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Image = NDArray[np.float32]

__all__ = ["poisson_image"]


def poisson_image(across: Image, down: Image, mean: float) -> Image:
    """Find the picture with given gradients, in least squares.

    Parameters
    ----------
    across, down : (h, w) arrays
        Differences to the right and to the lower neighbour, in units of the picture. The last
        column of `across` and the last row of `down` have no neighbour and do not count.
    mean : float
        Mean of the picture.

    Returns
    -------
    (h, w) array of float32
        The picture.

    Raises
    ------
    ValueError
        If the gradients differ in shape or are no planes.

    """
    if across.ndim != 2 or across.shape != down.shape:
        msg = f"gradients of shapes {across.shape} and {down.shape} are not those of one picture"
        raise ValueError(msg)
    height, width = across.shape
    # D_x' g_x + D_y' g_y
    target = np.zeros((height, width))
    target[:, :-1] -= across[:, :-1]
    target[:, 1:] += across[:, :-1]
    target[:-1] -= down[:-1]
    target[1:] += down[:-1]
    # D'D of n pixels has the eigenvalues 2 - 2 cos(pi k / n)
    rows, columns = (2 - 2 * np.cos(np.pi * np.arange(n) / n) for n in (height, width))
    eigenvalues = rows[:, None] + columns
    eigenvalues[0, 0] = 1
    spectrum = dctn(target, norm="ortho", overwrite_x=True) / eigenvalues
    spectrum[0, 0] = mean * np.sqrt(height * width)
    picture: Image = idctn(spectrum, norm="ortho", overwrite_x=True).astype(np.float32)
    return picture
