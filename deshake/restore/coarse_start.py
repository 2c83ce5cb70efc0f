"""First estimate of the latent image, from the photo at half its size.

At half the size the blur is half as wide, and noise is weaker. So Richardson-Lucy finds there what
is coarse, in a quarter of the time. A few iterations at the full size find the rest. They see the
mean of the colours. Their factors hold for every colour, because edges of colour alone are coarse
in most photos.

With all iterations at the full size, noise becomes as strong as fine detail, and what follows keeps
it as edges.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import channels_first, mean_plane
from deshake.operators.shake_blur import blur_filters
from deshake.restore.multiplicative_descent import LEAST_LIGHT
from deshake.restore.richardson_lucy import latent_start, latent_start_by_mean
from deshake.signal.pyramid import reduced

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel
    from deshake.operators.shake_blur import Filters
    from deshake.run import Run

__all__ = ["Iterations", "coarse_start"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_FINE_EFFORT = 4  # duration of an iteration at the full size over one at half the size


class Iterations(NamedTuple):
    """Iterations on the mean of the colours, and at most on the colours; then at the full size."""

    mean: int
    coloured: int
    fine: int


def coarse_start(
    g: Image,
    kernel: RotationKernel,
    blur: Filters,
    *,
    margin: int,
    clipped: Mask | None,
    iterations: Iterations,
    run: Run,
) -> Image:
    """Return a first estimate for another method, with lights above the clip level.

    Parameters
    ----------
    g, kernel, clipped, run
        As for `richardson_lucy`.
    blur : Filters
        The blur A of this kernel.
    margin : int
        Pixels by which its latent images are larger on every side.
    iterations : Iterations
        Accelerated iterations at half the size and at the full size.

    Returns
    -------
    (C, H, W) array of float32
        The latent image with the margin of the blur.

    """
    efforts = (iterations.mean + iterations.coloured, _FINE_EFFORT * iterations.fine)
    coarse, fine = run.parts(efforts)
    half, half_clipped = _halved(g, clipped)
    height, width = half.shape[:2]
    camera = kernel.camera.cropped(0, 0, 2 * width, 2 * height).scaled(height, width)
    half_margin = -(-margin // 2)
    half_blur = blur_filters(
        kernel.for_camera(camera),
        margin=half_margin,
        rough=True,
        channels=len(channels_first(g)),
        run=run,
    )
    small = latent_start_by_mean(
        half,
        half_blur,
        clipped=half_clipped,
        iterations=iterations.mean,
        coloured=iterations.coloured,
        run=coarse,
    )
    shape = g.shape[0] + 2 * margin, g.shape[1] + 2 * margin
    f = _doubled(small, shape, first=2 * half_margin - margin)
    mean = mean_plane(f)[None]
    finer = latent_start(
        mean_plane(channels_first(g)),
        blur,
        clipped=clipped,
        iterations=iterations.fine,
        f=mean,
        run=fine,
    )
    f *= finer / mean
    return f


def _halved(g: Image, clipped: Mask | None) -> tuple[Image, Mask | None]:
    """Return a photo and its clipped pixels at half the size; odd sides get one more pixel."""
    rows, columns = (side % 2 for side in g.shape[:2])
    if rows or columns:
        g = np.pad(g, [(0, rows), (0, columns), (0, 0)][: g.ndim], mode="edge")
    height, width = (side // 2 for side in g.shape[:2])
    half = reduced(g, (height, width))
    if clipped is None:
        return half, None
    clipped = np.pad(clipped, [(0, rows), (0, columns)], mode="edge")
    return half, np.asarray(clipped.reshape(height, 2, width, 2).any((1, 3)))


def _doubled(small: Image, shape: tuple[int, int], first: int) -> Image:
    """Return planes (C, ., .) at twice the size, cut to a height and width from a first pixel."""
    f = np.empty((len(small), *shape), np.float32)
    rows, columns = (slice(first, first + side) for side in shape)
    for plane, out in zip(small, f, strict=True):
        size = 2 * plane.shape[1], 2 * plane.shape[0]
        large = cv2.resize(plane, size, interpolation=cv2.INTER_CUBIC)
        np.maximum(large[rows, columns], LEAST_LIGHT, out=out)
    return f
