"""Residual Richardson-Lucy: adds to a denoised photo the detail of a blurred one (Sec. 6).

The deconvolution works on the residual of the denoised noisy photo f_D [1],

    delta g = g - A f_D,
    delta f <- (delta f + 1) . A^T((delta g + 1) / A(delta f + 1)) / A^T 1 - 1,

where 1 keeps the light positive; f = f_D + delta f rings less, since delta f has little contrast. A
gain map multiplies delta f after each iteration:

    1 - alpha + alpha sum_l |D f_D^l|,

over the levels l of f_D's pyramid. It weakens delta f where the scene is flat. A detail layer
restores the detail that this removes: the result without the map, f, less its joint bilateral mean
guided by the result with the map, f_g. The photo is f_g + (f - mean f), in display values.

Too many iterations fit the noise of g, too, and amplify it. So the iterations end when the residual
of g is no more than its noise, at a scale that compression does not change (`coarse_noise`): the
discrepancy principle.

References
----------
.. [1] L. Yuan, J. Sun, L. Quan and H.-Y. Shum, "Image deblurring with blurred/noisy image pairs",
   ACM Transactions on Graphics 26, 2007, https://doi.org/10.1145/1276377.1276379

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import channels_first, fitted, image_like, mean_plane
from deshake.operators.shake_blur import blur_filters
from deshake.operators.strips import bands, with_halo
from deshake.pair.pair_weights import agreement
from deshake.restore.restoration import Restoration, check_photo
from deshake.run import Run
from deshake.signal.noise import coarse_noise, pair_means

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel
    from deshake.operators.shake_blur import Filters
    from deshake.pair.denoising import NoisyPhoto

__all__ = ["gain_map", "joint_bilateral", "residual_richardson_lucy"]

Image = NDArray[np.float32]


@dataclass(frozen=True)
class _Settings:
    """Weights and thresholds of residual Richardson-Lucy.

    No record says what the values were tuned on; `bench.py pair` measures them together.

    Parameters
    ----------
    most : int
        Iterations at most, if no number is given.
    noise : float
        Factor of the estimated noise: a smaller residual ends the iterations.
    stalled : float
        Relative fall of the squared residual: a smaller fall ends the iterations.
    alpha : float
        Alpha of the gain map; with 0, there is no map.
    unseen : float32
        A^T 1: latent pixels with no more than this keep their value.
    dark : float32
        Light: least divisor and least target of a step.
    toe : float32
        Light: below about this, display values are linear.
    smallest_level : int
        Px: shorter side of the smallest level of the pyramid.
    near_px : float
        Px: sigma of the bilateral mean over places.
    alike : float
        Display values: sigma of the bilateral mean over tones.
    window : int
        Px from the middle of the bilateral window to its side; pixels farther away do not
        count.

    """

    most: int = 20
    noise: float = 1.1
    stalled: float = 0.02
    alpha: float = 0.2
    unseen: np.float32 = np.float32(1e-2)
    dark: np.float32 = np.float32(1e-3)
    toe: np.float32 = np.float32(3e-3)
    smallest_level: int = 32
    near_px: float = 1.6
    alike: float = 0.08
    window: int = 5


_SETTINGS: Final = _Settings()
_BAND = 256  # rows that are averaged at once


def residual_richardson_lucy(
    g: Image,
    noisy: NoisyPhoto,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    iterations: int | None = None,
    gain: bool = True,
    detail: bool = True,
    run: Run = Run(),
) -> Restoration:
    """Deblur a photo with the help of a denoised one.

    The result lies in the frame of the denoised photo: the kernel is not centred.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light.
    noisy : NoisyPhoto
        The noisy photo, denoised, registered and as bright as the blurred one: in its frame, or
        wider on all sides.
    kernel : RotationKernel
        The blur, for a camera of the photo's size.
    clipped : (h, w) array of bool, optional
        Clipped pixels of the blurred photo. The residual is 0 there, and where the photos disagree.
    iterations : int, optional
        Number of iterations, >= 1. By default 1 to 20: until the residual is as small as the noise,
        or an iteration reduces its square by less than 2 %.
    gain : bool
        Whether the gain map is used.
    detail : bool
        Whether the detail layer is added; without a gain map there is none.
    run : Run, optional
        Threads to use, and who receives the progress.

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
    planes = channels_first(g)
    if len(noisy.denoised) != len(planes):
        raise ValueError(f"a noisy photo of {noisy.denoised.shape} does not fit one of {g.shape}")
    most = iterations or _SETTINGS.most
    margin = kernel.reach_px()
    blur = blur_filters(kernel, margin=margin, channels=len(planes), run=run)
    coverage = np.maximum(blur.adjoint(np.ones((1, *g.shape[:2]), np.float32))[0], _SETTINGS.unseen)
    f_D = fitted(noisy.denoised, coverage.shape)
    gains = gain_map(image_like(f_D, g)) if gain else None
    left = blur.forward(f_D)
    agreeing = agreement(g, left, fitted(noisy.variance(), g.shape[:2]), margin)
    if clipped is not None:
        agreeing[clipped] = 0
    np.subtract(planes, left, out=left)
    left *= agreeing
    inside = np.s_[margin:-margin, margin:-margin]
    steps = iter(run.parts([1] * (2 if gain else 1) * len(planes)))
    counts, squared = [], 0.0
    out = np.empty(g.shape, np.float32)
    for c, (residual, denoised) in enumerate(zip(left, f_D, strict=True)):
        noise = _SETTINGS.noise * coarse_noise(planes[c]) if iterations is None else None
        change, count = _deconvolved(
            residual, blur, coverage, None, most=most, noise=noise, run=next(steps)
        )
        f = (denoised + change)[inside]
        if gains is not None:
            change, _ = _deconvolved(
                residual,
                blur,
                coverage,
                gains,
                most=count,
                noise=None,
                run=next(steps),
            )
            calm = (denoised + change)[inside]
            f = _with_detail(calm, f) if detail else calm
        counts.append(count)
        left[c] -= blur.forward(change[None])[0]
        squared += float(np.sum(np.square(left[c]), dtype=np.float64))
        channels_first(out)[c] = np.maximum(f, 0)
    return Restoration(out, max(counts), float(np.sqrt(squared / g.size)))


def gain_map(f_D: Image) -> Image:
    """Return the gain map (h, w) of a denoised photo (h, w) or (h, w, C), from its display values.

    Its gradients are those of the mean of the colours, in display values (0..1) per pixel.
    """
    level = _shown(mean_plane(channels_first(f_D)))
    height, width = level.shape
    gains = np.full(level.shape, 1 - _SETTINGS.alpha, np.float32)
    while True:
        down, across = (cv2.Sobel(level, cv2.CV_32F, *d, scale=1 / 8) for d in ((0, 1), (1, 0)))
        gradient = np.sqrt(np.square(down) + np.square(across))
        gains += np.float32(_SETTINGS.alpha) * cv2.resize(gradient, (width, height))
        if min(level.shape) < 2 * _SETTINGS.smallest_level:
            return gains
        level = np.asarray(cv2.pyrDown(level), np.float32)


def joint_bilateral(image: Image, guide: Image) -> Image:
    """Average an image (h, w) over near pixels whose values in a guide (h, w) are alike."""
    out = np.empty_like(image)
    for band in bands(len(image), _BAND):
        rows, own = with_halo(band, _SETTINGS.window, len(image))
        out[band] = _bilateral(image[rows], guide[rows])[own]
    return out


def _bilateral(image: Image, guide: Image) -> Image:
    """Average a band; the weight of each pair of pixels is computed once."""
    total, weight = image.copy(), np.ones_like(image)
    height, width = image.shape
    square = range(-_SETTINGS.window, _SETTINGS.window + 1)
    for down, across in ((y, x) for y in square for x in square if (y, x) > (0, 0)):
        left, right = max(-across, 0), max(across, 0)
        if down >= height or left + right >= width:
            continue
        here = slice(0, height - down), slice(left, width - right)
        there = slice(down, height), slice(right, width - left)
        w = np.square((guide[here] - guide[there]) / np.float32(_SETTINGS.alike))
        w += np.float32((down * down + across * across) / _SETTINGS.near_px**2)
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
    coverage: Image,
    gains: Image | None,
    *,
    most: int,
    noise: float | None,
    run: Run,
) -> tuple[Image, int]:
    """Deconvolve the residual of one colour; return delta f, (H, W), and the iterations."""
    f = np.ones_like(coverage)  # delta f + 1
    even = blur.forward(f[None])[0]
    target = np.maximum(left + even, _SETTINGS.dark)
    ratio, before, done = even, np.inf, 0
    while done < most:
        np.divide(target, np.maximum(ratio, _SETTINGS.dark), out=ratio)
        f *= np.where(coverage > _SETTINGS.unseen, blur.adjoint(ratio[None])[0] / coverage, 1)
        if gains is not None:
            f = (f - 1) * gains + 1
        done += 1
        if done == most:
            break
        ratio = blur.forward(f[None])[0]
        if noise is not None:
            squared = 4 * float(np.mean(np.square(pair_means(target - ratio)), dtype=np.float64))
            if squared <= noise or squared > (1 - _SETTINGS.stalled) * before:
                break
            before = squared
        run.report(done / most, f"deblurring the residual, iteration {done}")
    run.report(1.0, f"deblurring the residual, iteration {done}")
    f -= 1
    return f, done


def _with_detail(calm: Image, full: Image) -> Image:
    """Add the detail layer of a result without the gain map to the one with it."""
    shown, guide = _shown(full), _shown(calm)
    guide += shown - joint_bilateral(shown, guide)
    return _light(guide)


def _shown(light: Image) -> Image:
    """Return approximate display values of light: its root, but nearly linear near black."""
    shown: Image = np.sqrt(np.maximum(light, 0) + _SETTINGS.toe)
    shown -= np.sqrt(_SETTINGS.toe)
    return shown


def _light(shown: Image) -> Image:
    """Invert `_shown`; display values below 0 are black."""
    light: Image = np.square(np.maximum(shown, 0) + np.sqrt(_SETTINGS.toe))
    light -= _SETTINGS.toe
    return light
