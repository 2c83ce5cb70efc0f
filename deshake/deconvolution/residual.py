"""Residual Richardson-Lucy: what a denoised photo lacks, out of a blurred one (Sec. 6).

Not the photo is deconvolved but what the denoised noisy photo f_D does not explain of it [1],

    delta g = g - A f_D,
    delta f <- (delta f + 1) . A^T((delta g + 1) / A(delta f + 1)) / A^T 1 - 1,

with 1 added to keep the light positive; f = f_D + delta f rings less, since delta f has little
contrast. A gain map, that multiplies delta f after each iteration,

    1 - alpha + alpha sum_l |D f_D^l|,

over the levels l of f_D's pyramid, holds it back where the scene is even. What it costs in detail
comes back as a layer: the residual without the map, f, less its joint bilateral mean guided by the
result with the map f_g; f_g + (f - mean f), in display values, is the photo.

References
----------
.. [1] L. Yuan, J. Sun, L. Quan and H.-Y. Shum, "Image deblurring with blurred/noisy image pairs",
   ACM Transactions on Graphics 26, 2007, https://doi.org/10.1145/1276377.1276379

"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.deconvolution.restoration import Restoration, check_photo
from deshake.operators.filter_flow import reach
from deshake.operators.planes import channels_first
from deshake.operators.shake_blur import blur_filters

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.geometry.kernel import RotationKernel
    from deshake.operators.shake_blur import Filters

__all__ = ["gain_map", "joint_bilateral", "residual_richardson_lucy"]

Image = NDArray[np.float32]

_ITERATIONS = 20
_ALPHA = 0.2
_UNSEEN = np.float32(1e-2)
_DARK = np.float32(1e-3)
_TOE = np.float32(3e-3)
_SMALLEST_LEVEL = 32  # px
_NEAR_PX, _ALIKE = 1.6, 0.08  # sigmas of the bilateral mean: pixels, display values
_WINDOW = 5  # pixels from its middle to its side
_BAND = 256


def residual_richardson_lucy(
    g: Image,
    f_D: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    iterations: int | None = None,
    gain: bool = True,
    detail: bool = True,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Restoration:
    """Deblur a photo with the help of a denoised one.

    The result lies in the frame of the denoised photo: the kernel is not centred.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light.
    f_D : (h, w) or (h, w, C) array of float32
        The denoised photo, registered, as bright as the blurred one.
    kernel : RotationKernel
        The blur, for a camera of the photo's size.
    clipped : (h, w) array of bool, optional
        Where the blurred photo clipped; it has no residual there.
    iterations : int, optional
        How many, >= 1; by default 20.
    gain : bool
        Whether the gain map is used.
    detail : bool
        Whether the detail layer is added; without a gain map there is none.
    threads : int, optional
        Threads to use; by default all processors. The result does not depend on it.
    progress : callable, optional
        Told the fraction done, 0 to 1, and what is being done, after each iteration.

    Returns
    -------
    Restoration

    Raises
    ------
    ValueError
        If the photos are not finite or do not fit each other, the kernel's camera or the clipped
        pixels, or the iterations are fewer than 1.

    """
    check_photo(g, kernel, clipped, iterations)
    check_photo(f_D, kernel, None, None)
    if f_D.shape != g.shape:
        raise ValueError(f"a denoised photo of shape {f_D.shape} does not fit one of {g.shape}")
    count = iterations or _ITERATIONS
    runs = 2 if gain and detail else 1
    margin = reach(kernel.camera, kernel.theta[kernel.weights > 0])
    blur = blur_filters(kernel, margin=margin, channels=1, threads=threads)
    seen = np.maximum(blur.adjoint(np.ones((1, *g.shape[:2]), np.float32))[0], _UNSEEN)
    gains = gain_map(f_D) if gain else None
    around = np.pad(gains, margin, mode="edge") if gains is not None else None
    total = len(channels_first(g)) * runs * count
    done = 0

    def tell() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done / total, f"deblurring the residual, iteration {(done - 1) % count + 1}")

    out, squared = np.empty(g.shape, np.float32), 0.0
    for c, (observed, denoised) in enumerate(
        zip(channels_first(g), channels_first(f_D), strict=True)
    ):
        start = np.pad(denoised.astype(np.float32), margin, mode="edge")
        left = observed - blur.forward(start[None])[0]
        if clipped is not None:
            left[clipped] = 0
        change = _deconvolved(left, blur, seen, around, count=count, tell=tell)
        squared += float(np.sum(np.square(left - blur.forward(change[None])[0]), dtype=np.float64))
        inside = np.s_[margin:-margin, margin:-margin]
        f = denoised + change[inside]
        if runs == 2:
            change = _deconvolved(left, blur, seen, None, count=count, tell=tell)
            f = _with_detail(f, denoised + change[inside])
        channels_first(out)[c] = np.maximum(f, 0)
    return Restoration(out, count, float(np.sqrt(squared / g.size)))


def gain_map(f_D: Image) -> Image:
    """Return the gain map (h, w) of a denoised photo (h, w) or (h, w, C), from its display values.

    Its gradients are those of the mean of the colours, in shares of the whole range a pixel.
    """
    level = _shown(channels_first(f_D).mean(0, dtype=np.float32))
    height, width = level.shape
    gains = np.full(level.shape, 1 - _ALPHA, np.float32)
    while True:
        down, across = (cv2.Sobel(level, cv2.CV_32F, *d, scale=1 / 8) for d in ((0, 1), (1, 0)))
        gradient = cv2.magnitude(np.asarray(down, np.float32), np.asarray(across, np.float32))
        gains += np.float32(_ALPHA) * cv2.resize(gradient, (width, height))
        if min(level.shape) < 2 * _SMALLEST_LEVEL:
            return gains
        level = np.asarray(cv2.pyrDown(level), np.float32)


def joint_bilateral(image: Image, guide: Image) -> Image:
    """Average an image (h, w) over near pixels whose values in a guide (h, w) are alike."""
    out = np.empty_like(image)
    height = len(image)
    for top in range(0, height, _BAND):
        first, last = max(top - _WINDOW, 0), min(top + _BAND + _WINDOW, height)
        own = slice(top - first, min(top + _BAND, height) - first)
        out[top : top + _BAND] = _bilateral(image[first:last], guide[first:last])[own]
    return out


def _bilateral(image: Image, guide: Image) -> Image:
    """Average a band; each pair of pixels is weighed once and serves both."""
    total, weight = image.copy(), np.ones_like(image)
    height, width = image.shape
    square = range(-_WINDOW, _WINDOW + 1)
    for down, across in ((y, x) for y in square for x in square if (y, x) > (0, 0)):
        left, right = max(-across, 0), max(across, 0)
        if down >= height or left + right >= width:
            continue
        here = slice(0, height - down), slice(left, width - right)
        there = slice(down, height), slice(right, width - left)
        w = np.square((guide[here] - guide[there]) / np.float32(_ALIKE))
        w += np.float32((down * down + across * across) / _NEAR_PX**2)
        w = np.exp(w * np.float32(-0.5))
        total[here] += w * image[there]
        total[there] += w * image[here]
        weight[here] += w
        weight[there] += w
    total /= weight
    return total


def _deconvolved(
    left: Image,
    blur: Filters,
    seen: Image,
    gains: Image | None,
    *,
    count: int,
    tell: Callable[[], None],
) -> Image:
    """Deconvolve the residual of one colour; return delta f, (H, W)."""
    f = np.ones_like(seen)  # delta f + 1
    target = np.maximum(left + blur.forward(f[None])[0], _DARK)
    for _ in range(count):
        ratio = target / np.maximum(blur.forward(f[None])[0], _DARK)
        f *= np.where(seen > _UNSEEN, blur.adjoint(ratio[None])[0] / seen, 1)
        if gains is not None:
            f = (f - 1) * gains + 1
        tell()
    f -= 1
    return f


def _with_detail(calm: Image, full: Image) -> Image:
    """Add the detail layer of a result without the gain map to the one with it."""
    shown, guide = _shown(full), _shown(calm)
    guide += shown - joint_bilateral(shown, guide)
    return _light(guide)


def _shown(light: Image) -> Image:
    """Return about how light is displayed: its root, but a line near black."""
    shown: Image = np.sqrt(np.maximum(light, 0) + _TOE)
    shown -= np.sqrt(_TOE)
    return shown


def _light(shown: Image) -> Image:
    """Invert `_shown`; display values below 0 are black."""
    light: Image = np.square(np.maximum(shown, 0) + np.sqrt(_TOE))
    light -= _TOE
    return light
