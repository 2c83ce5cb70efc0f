"""Wiener deconvolution of uniform blur, by scikit-image: baselines for comparisons.

Both filters treat the frame as periodic, and each colour by itself. Beyond its border the photo is
mirrored and fades into its mean, so that opposite borders do not ring. Neither filter models
clipped pixels.

References
----------
.. [1] F. Orieux, J.-F. Giovannelli and T. Rodet, "Bayesian estimation of regularization and point
   spread function parameters for Wiener-Hunt deconvolution", J. Opt. Soc. Am. A 27, 2010,
   https://doi.org/10.1364/JOSAA.27.001593

"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deshake.errors import DeshakeError
from deshake.geometry.rotations import reach
from deshake.operators.bilinear import splat_on_raster
from deshake.operators.planes import channels_first
from deshake.operators.shake_blur import ShakeBlur
from deshake.restore.restoration import Restoration, check_photo
from deshake.run import Run
from deshake.signal.noise import coarse_noise

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.geometry.kernel import RotationKernel

    Filter = Callable[[NDArray[np.float32], NDArray[np.float32]], tuple[NDArray[np.float32], int]]

__all__ = ["point_spread", "unsupervised_wiener", "wiener"]

Image = NDArray[np.float32]

_SPREAD = 0.5  # px: displacements by a rotation that vary by more are an error: not uniform
_BORDER = 4  # reaches of the blur: width of the mirrored border
_ROUGHNESS = 0.02  # variance of a sharp scene's Laplacian over that of its light
_LEAST = 1e-6  # least balance: avoids division by 0 where the blur removes a frequency
_SAMPLES, _BURN_IN = 200, 15  # pictures that are drawn, and the first of them that are discarded


def wiener(
    g: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    iterations: int | None = None,
    run: Run = Run(),
) -> Restoration:
    """Deblur a uniformly blurred photo by the Wiener-Hunt filter.

    It minimises ``|h * f - g|^2 + balance |Laplacian f|^2``, which is best if the balance is the
    variance of the noise (`coarse_noise`) over that of the sharp scene's Laplacian. The latter is
    assumed to be 2 % of the variance of the light; blur hardly changes this variance.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light.
    kernel : RotationKernel
        The blur, for a camera of the photo's size; the result lies in the frame of its centroid.
    clipped : (h, w) array of bool, optional
        Clipped pixels: they change only the residual that is reported.
    iterations : None
        There are none.
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    Restoration

    Raises
    ------
    ValueError
        If `iterations` is given, or for the reasons of `check_photo`.
    DeshakeError
        If the blur is not the same all over the frame, or scikit-image is not installed.

    """
    if iterations is not None:
        raise ValueError("a Wiener filter has no iterations")
    check_photo(g, kernel, clipped, None)
    library = _library()
    balance = _balance(g)

    def deblurred(plane: Image, h: Image) -> tuple[Image, int]:
        return library.wiener(plane, h, balance, clip=False), 1

    return _filtered(g, kernel, clipped, deblurred, run=run)


def unsupervised_wiener(
    g: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    iterations: int | None = None,
    run: Run = Run(),
) -> Restoration:
    """Deblur a uniformly blurred photo by a Wiener-Hunt filter that estimates its balance [1].

    Pictures and balances are drawn in turn, from a fixed seed; the result is the pictures' mean.

    Parameters
    ----------
    g, kernel, clipped, run
        As for `wiener`.
    iterations : int, optional
        Largest number of pictures to draw, >= 1; by default 200. The first 15, or half of them if
        that is less, do not count.

    Returns
    -------
    Restoration
        Its iterations are those of the colour that took the most.

    Raises
    ------
    ValueError
        For the reasons of `check_photo`.
    DeshakeError
        If the blur is not the same all over the frame, or scikit-image is not installed.

    """
    check_photo(g, kernel, clipped, iterations)
    library = _library()
    most = iterations or _SAMPLES
    settings = {"max_num_iter": most, "burnin": min(_BURN_IN, most // 2 - 1)}

    def deblurred(plane: Image, h: Image) -> tuple[Image, int]:
        f, chains = library.unsupervised_wiener(plane, h, user_params=settings, clip=False, rng=0)
        return f, len(chains["noise"]) - 1

    return _filtered(g, kernel, clipped, deblurred, run=run)


def point_spread(kernel: RotationKernel) -> Image:
    """Picture of a point light under a uniform blur: the h of ``g = h * f``.

    By Eq. (7), under a rotation that moves the frame by d, a pixel shows the point d away. So the
    light of the point appears at -d.

    Parameters
    ----------
    kernel : RotationKernel
        The blur.

    Returns
    -------
    (2 r + 1, 2 r + 1) array of float32
        Shares of the light, summing to 1; the middle is the point itself.

    Raises
    ------
    DeshakeError
        If the blur is not the same all over the frame, to within half a pixel.

    """
    camera = kernel.camera
    spread = float(np.ptp(kernel.above(0.01).displacements(camera.corners), axis=0).max())
    if spread > _SPREAD:
        raise DeshakeError(
            f"a Wiener filter needs the same blur all over; this one differs by {spread:.1f} px",
            hint="choose another --method",
        )
    r = reach(camera, kernel.theta)
    middle = np.array([[(camera.width - 1) / 2, (camera.height - 1) / 2]])
    places = r - kernel.displacements(middle)[0]
    return splat_on_raster(places, kernel.weights, (2 * r + 1, 2 * r + 1)).astype(np.float32)


def _library() -> Any:  # noqa: ANN401 - a module without types
    """Import scikit-image, which takes a second and may be missing."""
    try:
        return import_module("skimage.restoration")
    except ImportError:
        raise DeshakeError(
            "the Wiener filters need scikit-image", hint="pip install 'deshake[wiener]'"
        ) from None


def _balance(g: Image) -> float:
    """Estimate the noise's variance over that of the sharp scene's Laplacian."""
    light = np.maximum(channels_first(g), 0)
    power = float(np.mean(light.var((1, 2), dtype=np.float64)))
    noise = coarse_noise(g)
    return max(noise / (_ROUGHNESS * power), _LEAST) if power > 0 else 1.0


def _continued(plane: Image, border: int) -> Image:
    """Mirror a photo at its edges and let it fade into its mean."""
    fade = np.float32(0.5) - np.float32(0.5) * np.cos(
        np.pi * (np.arange(border, dtype=np.float32) + 0.5) / border, dtype=np.float32
    )
    mean = plane.mean(dtype=np.float64).astype(np.float32)
    out: Image = np.pad(plane - mean, border, mode="symmetric")
    for axis in (out, out.T):
        axis[:border] *= fade[:, None]
        axis[-border:] *= fade[::-1, None]
    out += mean
    return out


def _filtered(
    g: Image,
    kernel: RotationKernel,
    clipped: NDArray[np.bool_] | None,
    deblurred: Filter,
    *,
    run: Run,
) -> Restoration:
    """Filter a photo colour by colour."""
    centred = kernel.centred()
    h = point_spread(centred)
    border = _BORDER * (len(h) // 2)
    blur = ShakeBlur(centred, margin=border, run=run)
    planes = channels_first(g)
    out = np.empty_like(g, np.float32, order="C")
    squares = count = 0.0
    most = 0
    for c, plane in enumerate(planes):
        f, iterations = deblurred(_continued(np.maximum(plane, 0), border), h)
        np.maximum(f, 0, out=f)
        residual = plane - blur.forward(f)
        kept = residual if clipped is None else residual[~clipped]
        squares += float(np.sum(np.square(kept), dtype=np.float64))
        count += kept.size
        channels_first(out)[c] = f[border:-border, border:-border]
        most = max(most, iterations)
        run.report((c + 1) / len(planes), f"deblurring, colour {c + 1}")
    return Restoration(out, most, float(np.sqrt(squares / max(count, 1))))
