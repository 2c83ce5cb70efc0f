"""Deblurring a photo with a noisy one of the same scene, Sec. 6."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from deshake.errors import DeshakeError
from deshake.geometry.camera import Camera
from deshake.lens.straightening import bent, straight_kernel, straight_pair, straightened
from deshake.operators.planes import channels_first
from deshake.operators.shake_blur import ShakeBlur
from deshake.pair.camera_tones import blurred_planes, camera_pair, fitted_factor
from deshake.pair.clipped_noise import unclipped_mean
from deshake.pair.denoising import NoisyPhoto, noisy_photo
from deshake.pair.fusion import fuse
from deshake.pair.registration import register, registered
from deshake.pair.residual import residual_richardson_lucy
from deshake.signal.luminance import luminance
from deshake.stages.calibration import camera_for
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.progress import part

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.formats.photo import Photo
    from deshake.geometry.kernel import RotationKernel
    from deshake.pair.registration import Registration
    from deshake.restore.restoration import Restoration
    from deshake.restore.sparse_gradients import Quality

    Progress = Callable[[float, str], None]

__all__ = ["PairMethod", "PairRestorationOptions", "deblur_pair"]

_log = logging.getLogger(__name__)

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

PairMethod = Literal["fusion", "residual"]
"""How a photo is deblurred with the help of a noisy one."""

_REGISTERED = 0.1  # of the time


@dataclass(frozen=True)
class PairRestorationOptions:
    """How a photo is deblurred with the help of a noisy one.

    Parameters
    ----------
    method : {"fusion", "residual"}
        Both photos in one energy, or Yuan's residual Richardson-Lucy.
    quality : {"fast", "default", "high"}
        How much time the fusion takes.
    iterations : int, optional
        How many the method does, >= 1.

    Raises
    ------
    ValueError
        If a name is unknown, or a choice does not go with the method.

    """

    method: PairMethod = "fusion"
    quality: Quality = "default"
    iterations: int | None = None

    def __post_init__(self) -> None:
        """Check the choices."""
        if self.method not in get_args(PairMethod):
            raise ValueError(f"no method {self.method!r} for pairs")
        if self.method != "fusion" and self.quality != "default":
            raise ValueError(f"{self.method} has one quality only")


def deblur_pair(
    blurred: Photo,
    noisy: Photo,
    kernel: RotationKernel,
    options: PairRestorationOptions,
    *,
    registration: Registration | None = None,
    keep_geometry: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Photo:
    """Deblur a photo with a kernel for its size and a noisy photo of the same scene.

    Format, depth, opacity and metadata stay as they are. Photos through a lens that bends are
    straightened first. The kernel of a camera that stood still undoes nothing else.

    Parameters
    ----------
    blurred, noisy : Photo
        The pair.
    kernel : RotationKernel
        The blur, in the frame of the registered noisy photo.
    options : PairRestorationOptions
        How.
    registration : Registration, optional
        How the noisy photo lies to the blurred one; by default it is found, with the kernel's
        camera or, if that is the uniform model's, the photo's.
    keep_geometry : bool
        Whether the result is bent again as the blurred photo was.
    threads : int, optional
        Threads to use; by default all processors.
    progress : callable, optional
        Told the fraction done and what is being done.

    Raises
    ------
    EstimationError
        If the photos do not show the same scene.

    """
    lens = kernel.camera if registration is None else registration.camera
    if not kernel.theta[kernel.weights > 0].any():
        if progress is not None:
            progress(1.0, "nothing to undo")
        return blurred if keep_geometry else straightened(blurred, lens)[0]
    start = 0.0
    straight, other, seen = straight_pair(blurred, noisy, lens, whole=keep_geometry)
    kernel = straight_kernel(kernel, lens, seen)
    try:
        if registration is None:
            start = _REGISTERED
            if kernel.camera.is_uniform:
                camera = camera_for(blurred, EstimateOptions())[0].camera
                zoom = seen.focal_px / lens.focal_px
                seen = Camera.from_focal(zoom * camera.focal_px, *straight.shape)
            registration = register(
                straight.pixels,
                unclipped_mean(other.pixels),
                seen,
                threads=threads,
                progress=part(progress, 0, start),
            )
        restored = _restored(
            straight,
            other,
            kernel,
            options,
            registration=registration if lens.is_pinhole else replace(registration, camera=seen),
            threads=threads,
            progress=part(progress, start, 1),
        )
    except DeshakeError as error:
        error.file = error.file or str(blurred.source)
        raise
    _log.info("%s: deblurred in %d iterations", blurred.source, restored.iterations)
    result = straight.with_pixels(restored.pixels)
    return bent(result, blurred, lens) if keep_geometry else result


def _restored(
    blurred: Photo,
    noisy: Photo,
    kernel: RotationKernel,
    options: PairRestorationOptions,
    *,
    registration: Registration,
    threads: int | None,
    progress: Progress | None,
) -> Restoration:
    """Register the noisy photo, make it as bright as the other one, and deblur."""
    g, f_N = blurred.pixels, noisy.pixels
    if f_N.ndim != g.ndim:
        f_N = luminance(f_N) if g.ndim == 2 else np.repeat(f_N[..., None], g.shape[2], 2)
    stored = unclipped_mean(f_N)
    stored *= np.float32(registration.scale)
    f_reg, valid = registered(stored, registration)
    clipped = registered(noisy.clipped.astype(np.float32), registration)[0] > 0
    usable = (valid > 0) & ~(clipped | blurred.clipped)
    light = unclipped_mean(g)
    blur = ShakeBlur(kernel, threads=threads)
    Af = blurred_planes(channels_first(f_reg), blur)
    scale = fitted_factor(light, Af, usable, blur)
    Af *= np.float32(scale)
    pair: NoisyPhoto | None = None
    if not (blurred.is_sensors and noisy.is_sensors):
        told = unclipped_mean(f_N)
        pair, trust = camera_pair(light, Af, told, registration, blur, mask=usable, threads=threads)
        valid *= trust
    del Af, f_reg
    if pair is None:
        resample = partial(registered, registration=registration, margin=blur.margin)
        stored *= np.float32(scale)
        clipped = resample(noisy.clipped.astype(np.float32))[0] > 0
        pair, valid = noisy_photo(light, stored, resample, threads=threads)
    del stored
    if options.method == "residual":
        return residual_richardson_lucy(
            light,
            pair,
            kernel,
            clipped=blurred.clipped,
            iterations=options.iterations,
            threads=threads,
            progress=progress,
        )
    return fuse(
        light,
        pair,
        valid,
        kernel,
        clipped=blurred.clipped,
        noisy_clipped=clipped,
        quality=options.quality,
        iterations=options.iterations,
        threads=threads,
        progress=progress,
    )
