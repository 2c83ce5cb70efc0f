"""Estimate of the blur kernel of one photo by variational inference (Secs. 5 and 7)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.bounds import check_size
from deshake.blind.result import BlindEstimate
from deshake.blind.variational import priors
from deshake.blind.variational.coarse_to_fine import PyramidPlan, resize
from deshake.blind.variational.scales import ScaleByScale
from deshake.blind.variational.settings import SETTINGS
from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.run import Run

__all__ = ["BLUR_SHARES", "estimate_variational"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

BLUR_SHARES = (0.015, 0.025, 0.04, 0.06)
"""Bounds of the blur to try if none is given, as shares of the photo's longer side."""


def estimate_variational(
    grey: Image,
    camera: Camera,
    *,
    clipped: Mask | None = None,
    blur_px: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    uniform: bool = False,
    finest: bool = False,
    roll_rate: float = priors.ROLL_RATE,
    run: Run = Run(),
) -> BlindEstimate:
    """Estimate the blur kernel of one photo by variational inference, coarse to fine.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 0..1.
    camera : Camera
        Its camera.
    clipped : (h, w) array of bool, optional
        Pixels that are not used.
    blur_px : float, optional
        Bound of the blur in pixels of the photo. By default the smallest of `BLUR_SHARES` that the
        kernel does not touch at a coarse scale; if it touches all, the one that it touches least.
    region : (x, y, width, height), optional
        The part of the photo that the estimate uses; by default all of it.
    uniform : bool
        Use the uniform model: theta_Z = 0 and a very long focal length.
    finest : bool
        Continue to the finest scale at any width of the blur. By default the estimate ends at the
        scale where the blur is 22 px wide.
    roll_rate : float
        Rate of the prior on turns about the optical axis, as `priors.ROLL_RATE`; 0, no prior, for
        a camera that was not in a hand.
    run : Run, optional
        Threads to use, and who receives the progress.

    Raises
    ------
    EstimationError
        If the photo is too small, too flat or too much clipped.

    References
    ----------
    Whyte, Sivic, Zisserman & Ponce, CVPR 2010, Sec. 5; MacKay & Miskin 2000; Fergus et al. 2006.

    """
    height, width = grey.shape
    whole = Camera.uniform(height, width) if uniform else camera
    x, y, w, h = (0, 0, width, height) if region is None else region
    picture, bad = grey[y : y + h, x : x + w], np.zeros((h, w), bool)
    if clipped is not None:
        bad = clipped[y : y + h, x : x + w]
    bounds = [share * max(w, h) for share in BLUR_SHARES] if blur_px is None else [blur_px]
    bounds = [b for b in bounds if b <= min(w, h) / 2] or bounds[:1]
    check_size(h, w, bounds[0])
    axes = (True, True, False) if uniform else ALL_AXES
    scale = min(1.0, SETTINGS.longest_side / max(h, w))
    shape = round(h * scale), round(w * scale)
    contrast = _contrast_scale(picture)
    small = resize((picture * contrast)[None], shape)[0]
    usable = resize(1 - bad.astype(np.float32)[None], shape)[0] > 1 - 1e-3
    run = run.rising()
    trials = []
    for bound in bounds:
        plan = PyramidPlan(whole.cropped(x, y, w, h).scaled(*shape), bound * scale, axes)
        trials.append(
            ScaleByScale(
                plan,
                _gradients(_smoothed(small, bound * scale)),
                usable,
                finest=finest,
                roll_rate=roll_rate,
                run=run,
            )
        )
        if len(bounds) == 1 or trials[-1].try_coarse() <= SETTINGS.close:
            break
    # if every kernel touches its bounds, the one with the least weight there is the best
    scales = min(reversed(trials), key=lambda tried: tried.outermost)
    kernel, confidence = scales.run()
    notes = scales.notes
    final = RotationKernel(kernel.theta, kernel.weights, kernel.steps, whole).centred()
    latent = scales.latent_gradients() / contrast
    return BlindEstimate(final, confidence, notes, scales.reports, latent)


def _contrast_scale(grey: Image) -> np.float32:
    """Return the factor that scales a photo to the contrast of the gradient priors."""
    scale = min(1.0, SETTINGS.contrast_side / max(grey.shape))
    shape = max(round(grey.shape[0] * scale), 2), max(round(grey.shape[1] * scale), 2)
    small = resize(grey[None], shape)[0] * priors.INTENSITY_RANGE
    across, down = np.diff(small, axis=1)[:-1], np.diff(small, axis=0)[:, :-1]
    contrast = float(np.sqrt((across**2 + down**2).mean()))
    if not contrast > SETTINGS.least_contrast:
        msg = "there is no detail to estimate the shake from"
        raise EstimationError(msg, hint="the photo is all of one colour, or nearly so")
    return np.float32(priors.INTENSITY_RANGE * SETTINGS.contrast / contrast)


def _smoothed(image: Image, blur_px: float) -> Image:
    """Smooth a photo a little, with a sigma that grows with the bound of its blur and its noise.

    On the finest detail, kernels of wide blurs break up, and the noise of differences puts a spike
    into any kernel. The median of second differences across 2 x 2 pixels measures the noise.
    """
    across = image[1:, 1:] - image[1:, :-1] - image[:-1, 1:] + image[:-1, :-1]
    noise = float(np.median(np.abs(across))) / 2 / 0.6745
    width = SETTINGS.smoothing * (blur_px - SETTINGS.fine_blur)
    sigma = min(max(width, SETTINGS.smoothing_noise * noise), SETTINGS.most_smoothing)
    if not sigma > 0:
        return image
    smooth: Image = cv2.GaussianBlur(image, (0, 0), sigma).astype(np.float32)
    return smooth


def _gradients(image: Image) -> Image:
    """Differences to the right and lower neighbour, (2, h, w), zero at the far edges."""
    out = np.zeros((2, *image.shape), np.float32)
    np.subtract(image[:, 1:], image[:, :-1], out=out[0, :, :-1])
    np.subtract(image[1:], image[:-1], out=out[1, :-1])
    return out
