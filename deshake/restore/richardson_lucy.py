"""Richardson-Lucy deconvolution with a known rotation kernel, Eq. (11).

    f <- f . A^T(g / A f) / A^T 1

A is the filter flow of the kernel, on a latent image that reaches beyond the frame as far as the
blur does. The scene there is unknown; it starts as the frame's edge pixels and is estimated with
the rest, so that no border rings. A clipped pixel gives only a lower bound of the light. With the
sensor's response R in the model, clipped pixels do no harm [2]:

    f <- f . A^T(g R'(A f) / R(A f) + 1 - R'(A f)) / A^T 1,
    R(x) = x - log(1 + exp(a (x - 1))) / a

With total variation as a prior [3], each iteration makes a picture u from f, and smooths it by [4]

    f <- argmin_v sum A^T 1 (v - u)^2 / 2f + sum lambda |D v|.

This ends where [3] ends, f (1 - div(lambda D f / |D f|) / A^T 1) = u. Where a picture is flat, that
quotient is undefined, and this step is not. The step may have any length.

References
----------
.. [1] D. Biggs and M. Andrews, "Acceleration of iterative image restoration algorithms",
   Applied Optics 36, 1997, https://doi.org/10.1364/AO.36.001766
.. [2] O. Whyte, J. Sivic and A. Zisserman, "Deblurring shaken and partially saturated images",
   IJCV 110, 2014, https://doi.org/10.1007/s11263-014-0727-3
.. [3] N. Dey et al., "Richardson-Lucy algorithm with total variation regularization for 3D
   confocal microscope deconvolution", Microscopy Research and Technique 69, 2006,
   https://doi.org/10.1002/jemt.20294
.. [4] A. Sawatzky, C. Brune, T. Koesters, F. Wuebbeling and M. Burger, "EM-TV methods for inverse
   problems with Poisson noise", in Level Set and PDE Based Reconstruction Methods in Imaging, 2013,
   https://doi.org/10.1007/978-3-319-01712-9_2

"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deshake.operators.planes import channels_first, mean_plane
from deshake.operators.shake_blur import blur_filters
from deshake.restore.multiplicative_descent import MultiplicativeDescent, blurred_back
from deshake.restore.restoration import Restoration, check_photo
from deshake.run import Run
from deshake.signal.noise import coarse_noise

if TYPE_CHECKING:
    from deshake.geometry.kernel import RotationKernel
    from deshake.operators.shake_blur import Filters

__all__ = ["latent_start", "latent_start_by_mean", "richardson_lucy", "richardson_lucy_tv"]

Image = NDArray[np.float32]

_FASTEST = 0.75  # longest step of the extrapolation; with more, noise grows faster than detail
_FASTEST_TV = 0.5  # the same with total variation
_FEWEST, _MOST, _MOST_TV = 2, 40, 30  # iterations: at least, at most, at most with total variation
_NOISE = 1.1  # factor of the estimated noise: a smaller residual ends the iterations
_NOISE_TV = 0.75  # the same with total variation, which keeps noise low without an early end
# relative fall of the squared residual, accelerated or not: a smaller one ends the iterations
_STALLED = {True: 0.1, False: 0.025}
_STALLED_TV = 0.015  # the same with total variation
_STALLED_COLOURS = 0.3  # the same on the colours, after iterations on their mean
_STALLING = 1 / 1.6  # the falls shrink about as iterations^-1.6


def richardson_lucy(
    g: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    iterations: int | None = None,
    accelerated: bool = True,
    run: Run = Run(),
) -> Restoration:
    """Deblur a photo whose rotation kernel is known.

    The result lies in the frame of the blur's centroid: the kernel is centred first.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light, 1 where it clips; values below 0 count as 0.
    kernel : RotationKernel
        The blur, for a camera of the photo's size.
    clipped : (h, w) array of bool, optional
        Clipped pixels. If there are any, the model includes the sensor's response.
    iterations : int, optional
        Number of iterations, >= 1. By default 2 to 40. They end when the residual is at most 1.1
        times the noise, at a scale where JPEG compression keeps the noise (`coarse_noise`). They
        also end when one of them reduces the squared residual by less than 10 % (2.5 % if not
        accelerated). Detail appears fast, noise and the faults of an estimated kernel slowly.
    accelerated : bool
        Extrapolate from one iteration to the next [1]: about half as many iterations.
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    Restoration

    Raises
    ------
    ValueError
        If the photo is not finite or does not fit the kernel's camera or the clipped pixels, or
        the iterations are fewer than 1.

    """
    check_photo(g, kernel, clipped, iterations)
    fastest = _FASTEST if accelerated else 0.0
    blur = blur_filters(kernel.centred(), channels=len(channels_first(g)), run=run)
    descent = MultiplicativeDescent(g, blur, clipped, fastest=fastest, run=run)
    noise = _NOISE * coarse_noise(g) if iterations is None else 0.0
    stalled = _STALLED[accelerated] if iterations is None else None
    return _descended(descent, iterations or _MOST, stalled, noise, run)


def richardson_lucy_tv(
    g: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    iterations: int | None = None,
    run: Run = Run(),
) -> Restoration:
    """Deblur a photo whose rotation kernel is known; keep its total variation low.

    As `richardson_lucy`, accelerated, with a prior whose weight follows from the photo's noise
    (`variation_weight`). Noise grows more slowly with the iterations, so more of them are useful.

    Parameters
    ----------
    g, kernel, clipped, run
        As for `richardson_lucy`.
    iterations : int, optional
        Number of iterations, >= 1. By default 2 to 30. They end when the residual is at most three
        quarters of the noise (`coarse_noise`), if nothing clipped. They also end when one of them
        reduces the squared residual by less than 1.5 %.

    Returns
    -------
    Restoration

    Raises
    ------
    ValueError
        If the photo is not finite or does not fit the kernel's camera or the clipped pixels, or
        the iterations are fewer than 1.

    """
    check_photo(g, kernel, clipped, iterations)
    blur = blur_filters(kernel.centred(), channels=len(channels_first(g)), run=run)
    descent = MultiplicativeDescent(g, blur, clipped, fastest=_FASTEST_TV, smooth=True, run=run)
    # if lights clip, the residual is measured on darker pixels than the noise
    early = iterations is None and descent.clipped is None
    noise = _NOISE_TV * coarse_noise(g) if early else 0.0
    stalled = _STALLED_TV if iterations is None else None
    return _descended(descent, iterations or _MOST_TV, stalled, noise, run)


def _descended(
    descent: MultiplicativeDescent,
    most: int,
    stalled: float | None,
    noise: float,
    run: Run,
) -> Restoration:
    """Iterate until the residual equals the noise or stalls; return the estimate in the frame."""
    done, squared = _iterated(descent, most, stalled, noise, run)
    return Restoration(descent.frame(), done, float(np.sqrt(squared)))


def _iterated(
    descent: MultiplicativeDescent,
    most: int,
    stalled: float | None,
    noise: float,
    run: Run,
) -> tuple[int, float]:
    """Iterate until the residual equals the noise or stalls, at most `most` times.

    Return the number of iterations, and the squared residual that the last one began with.
    """
    squared, done, part = np.inf, 0, 0.0
    while done < most and part < 1:
        before = squared
        squared, coarse = descent.step()
        done += 1
        part = done / most
        if stalled is not None and done >= _FEWEST:
            fall = 1 - squared / before if squared > 0 else 0.0
            part = max(part, (stalled / max(fall, stalled)) ** _STALLING)
            part = max(part, np.sqrt(noise / max(coarse, noise)) if noise > 0 else 0.0)
        run.report(part, f"deblurring, iteration {done}")
    return done, squared


def latent_start(
    g: Image,
    blur: Filters,
    *,
    clipped: NDArray[np.bool_] | None,
    iterations: int,
    f: Image | None = None,
    run: Run,
) -> Image:
    """Return a first estimate for another method, with lights above the clip level.

    Parameters
    ----------
    g, clipped, run
        As for `richardson_lucy`.
    blur : Filters
        The blur A.
    iterations : int
        Number of accelerated iterations.
    f : (C, H, W) array of float32, optional
        The latent image to begin with, > 0; by default the photo, blurred back.
    run : Run
        Receives the progress.

    Returns
    -------
    (C, H, W) array of float32
        The latent image with the margin of the blur.

    """
    f = None if f is None else f.copy()
    descent = MultiplicativeDescent(g, blur, clipped, fastest=_FASTEST, f=f, run=run)
    _iterated(descent, iterations, None, 0.0, run)
    return descent.f


def latent_start_by_mean(
    g: Image,
    blur: Filters,
    *,
    clipped: NDArray[np.bool_] | None,
    iterations: int,
    coloured: int,
    run: Run,
) -> Image:
    """Return a first estimate as `latent_start` does, in less time for a photo of colours.

    The first iterations see the mean of the colours, which is one plane in place of three. Their
    factors hold for every colour. Edges between colours of the same light need the iterations that
    follow. These end when one of them reduces the squared residual by less than 30 %.

    Parameters
    ----------
    g, blur, clipped, run
        As for `latent_start`.
    iterations : int
        Number of accelerated iterations on the mean of the colours.
    coloured : int
        Most accelerated iterations on the colours, if there is more than one.

    Returns
    -------
    (C, H, W) array of float32
        The latent image with the margin of the blur.

    """
    planes = channels_first(g)
    on_mean, on_colours = run.parts((iterations, coloured if len(planes) > 1 else 0))
    mean = MultiplicativeDescent(mean_plane(planes), blur, clipped, fastest=_FASTEST, run=run)
    first = mean.f.copy()
    _iterated(mean, iterations, None, 0.0, on_mean)
    if len(planes) == 1:
        return mean.f
    f = blurred_back(planes, blur, mean.coverage)
    f *= mean.f / first
    coverage = mean.coverage
    del mean, first
    descent = MultiplicativeDescent(
        g, blur, clipped, fastest=_FASTEST, f=f, coverage=coverage, run=run
    )
    _iterated(descent, coloured, _STALLED_COLOURS, 0.0, on_colours)
    return descent.f
