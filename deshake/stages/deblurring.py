"""Deblurring a photo whose kernel is known, alone or with a noisy photo of the same scene (Sec. 6).

`deblur` works on photos, `deblur_file` works from file to file. All outputs are checked before the
work begins, and appear whole or not at all.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deshake.blind.tones import suited_tones
from deshake.errors import DeshakeError, OutputError
from deshake.files.disk import STREAM, check_output
from deshake.files.kernel_file import KernelFile, read_kernel
from deshake.formats.camera_curve import light_before
from deshake.formats.output_names import default_output
from deshake.formats.photo import read_pair, read_photo
from deshake.geometry.camera import Camera
from deshake.lens.lens_warp import LensWarp
from deshake.lens.straightening import bent, straight_kernel, straight_pair, straightened
from deshake.operators.planes import channels_first
from deshake.operators.shake_blur import ShakeBlur
from deshake.pair.camera_tones import blurred_planes, camera_pair, fitted_factor
from deshake.pair.clipped_noise import unclipped_mean
from deshake.pair.denoising import NoisyPhoto, noisy_photo
from deshake.pair.registration import register, registered
from deshake.restore.dark_halos import without_dark_halos
from deshake.restore.moving_parts import moving_share
from deshake.run import Run
from deshake.signal.luminance import luminance
from deshake.stages.blending import blended
from deshake.stages.calibration import camera_for
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.finishing import AS_IT_IS, FinishingOptions
from deshake.stages.fitting import check_registration, fitting_kernel
from deshake.stages.methods import METHODS, RestorationOptions, default_method, restore
from deshake.stages.outputs import prepared, write_result
from deshake.stages.photo_provenance import photo_provenance
from deshake.stages.preview import preview_photo
from deshake.stages.registering import known_registration, search_range

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from deshake.formats.photo import Photo
    from deshake.formats.transfer import TransferName
    from deshake.geometry.kernel import RotationKernel
    from deshake.pair.registration import Registration
    from deshake.restore.restoration import Restoration
    from deshake.stages.outputs import Observer

__all__ = ["Deblurred", "deblur", "deblur_file", "in_linear_tones"]

_log = logging.getLogger(__name__)

_REGISTERED = 0.1  # share of the time for the registration


class Deblurred(NamedTuple):
    """A deblurred photo.

    Parameters
    ----------
    photo : Photo
        The result.
    kept : (H, W) array of float32 or None
        Share of the photo that was kept where something moved, 0..1; None: it was not asked for,
        or there was nothing to undo.

    """

    photo: Photo
    kept: NDArray[np.float32] | None = None


def deblur(
    photo: Photo,
    kernel: RotationKernel,
    options: RestorationOptions | None = None,
    *,
    noisy: Photo | None = None,
    registration: Registration | None = None,
    search_angle: float | None = None,
    keep_geometry: bool = False,
    protect_moving: bool = False,
    run: Run = Run(),
) -> Deblurred:
    """Deblur a photo with a kernel for its size, alone or with a noisy photo of the same scene.

    Format, depth, opacity and metadata do not change. The kernel of a still camera leaves the photo
    unchanged. Without a noisy photo, dark halos are limited so that they do not become black, and
    the photo is deblurred in the tones that the kernel suits: linear light, display values, or the
    light before a camera's tone curve. A photo from a lens with distortion is straightened first,
    and EXIF describes the new frame.

    Parameters
    ----------
    photo : Photo
        The photo.
    kernel : RotationKernel
        Its blur; with a noisy photo, in the frame of the registered noisy photo.
    options : RestorationOptions, optional
        Method and its options; by default the default method, with a noisy photo or without.
    noisy : Photo, optional
        The noisy photo.
    registration : Registration, optional
        Registration of the two photos. By default they are registered, with the kernel's camera,
        or with the photo's camera if the kernel's is that of the uniform model.
    search_angle : float, optional
        Range of the search for the registration, in degrees about any axis; by default 10.
    keep_geometry : bool
        Whether the result keeps the lens distortion of the photo.
    protect_moving : bool
        Whether parts whose blur is not that of the camera keep the photo (`moving_share`).
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    Deblurred

    Raises
    ------
    CalibrationError
        If the lens distortion is too strong to undo.
    EstimationError
        If the two photos do not show the same scene.
    ValueError
        If the method needs a noisy photo and there is none, or takes none and there is one.

    """
    options = options or RestorationOptions(default_method(noisy=noisy is not None))
    if options.needs_noisy != (noisy is not None):
        takes = "needs a noisy photo" if options.needs_noisy else "takes no noisy photo"
        raise ValueError(f"{options.method} {takes}")
    lens = kernel.camera if registration is None else registration.camera
    if kernel.is_still:
        run.report(1.0, "nothing to undo")
        return Deblurred(photo if keep_geometry else straightened(photo, lens)[0])
    try:
        if noisy is None:
            straight, pinhole = straightened(photo, lens, whole=keep_geometry)
            kernel = straight_kernel(kernel, lens, pinhole)
            straight = in_linear_tones(straight, kernel, run=run)
            restored = restore(
                straight.pixels,
                kernel,
                options,
                clipped=straight.clipped,
                run=run,
            )
            pixels = without_dark_halos(restored.pixels, straight.pixels, kernel)
            kernel = kernel.centred()  # the frame of the result
        else:
            straight, other, pinhole = straight_pair(photo, noisy, lens, whole=keep_geometry)
            kernel = straight_kernel(kernel, lens, pinhole)
            start = 0.0
            if registration is None:
                start = _REGISTERED
                if kernel.camera.is_uniform:
                    pinhole = _assumed_camera(photo, pinhole, pinhole.focal_px / lens.focal_px)
                registration = register(
                    straight.pixels,
                    unclipped_mean(other.pixels),
                    pinhole,
                    max_angle=search_range(search_angle),
                    run=run.part(0, start),
                )
            elif not lens.is_pinhole:
                registration = replace(registration, camera=pinhole)
            restored = _pair_restored(
                straight,
                other,
                kernel,
                options,
                registration=registration,
                run=run.part(start, 1),
            )
            pixels = restored.pixels
    except DeshakeError as error:
        error.file = error.file or str(photo.source)
        raise
    _log.info("%s: deblurred in %d iterations", photo.source, restored.iterations)
    del restored
    result, kept = straight.with_pixels(pixels), None
    if protect_moving:
        kept = moving_share(
            straight.pixels, pixels, kernel, clipped=straight.clipped, run=run.silent()
        )
        result = blended(straight, result, mask=kept)
    result = result.with_tones_of(photo)
    if keep_geometry and not lens.is_pinhole:
        result = bent(result, photo, lens)
        kept = None if kept is None else LensWarp(lens, pinhole).bend(kept)
    return Deblurred(result, kept)


def deblur_file(
    source: Path,
    kernel_file: Path,
    output: Path | None,
    *,
    noisy: Path | None = None,
    registration: Path | None = None,
    search_angle: float | None = None,
    transfer: TransferName | None = None,
    restoration: RestorationOptions | None = None,
    finish: FinishingOptions = AS_IT_IS,
    observer: Observer | None = None,
    overwrite: bool = False,
    overwrite_others: bool = False,
    keep_result: bool = False,
    run: Run = Run(),
) -> KernelFile:
    """Deblur a photo with the kernel of a file, alone or with a noisy one, and write the result.

    Without `output`, or if it is a folder, the name of the result is ``<stem>.deshaken.<ext>``. The
    sheet of `finish` appears only together with the result. With `keep_result` the result exists
    already and is kept. The `observer` receives the photo, its result and the kernel before they
    are written.

    Returns
    -------
    KernelFile
        The content of the kernel file.

    Raises
    ------
    PhotoError, KernelFileError, EstimationError
        If a photo, the kernel or the registration cannot be read, or they do not fit each other.
    OutputError
        If the result cannot be written.

    """
    if output is not None and str(output) == STREAM:
        raise OutputError("photos are not written to standard output", hint="name a file with -o")
    restoration = restoration or RestorationOptions(default_method(noisy=noisy is not None))
    path = default_output(source, output, overwrite=overwrite or keep_result)
    inputs = [item for item in (noisy, kernel_file, registration) if item is not None]
    check_output(path, *inputs, overwrite=overwrite or keep_result)
    finish.check(path, source, *inputs, overwrite=overwrite_others)
    content = read_kernel(kernel_file)
    given = None if registration is None else known_registration(registration)
    other: Photo | None = None
    if noisy is None:
        photo = read_photo(source, transfer=transfer)
    else:
        photo, other = read_pair(source, noisy, transfer=transfer)
    photo = prepared(photo, path, finish)
    if given is not None:
        check_registration(given.camera, photo, registration)
    photo, mask = finish.prepare(photo)
    if other is not None and finish.preview:
        other = preview_photo(other)
        given = None if given is None else replace(given, camera=given.camera.scaled(*photo.shape))
    kernel = fitting_kernel(content, photo, kernel_file)
    result, kept = deblur(
        photo,
        kernel,
        restoration,
        noisy=other,
        registration=given,
        search_angle=search_angle,
        keep_geometry=finish.keep_geometry,
        protect_moving=finish.protect_moving,
        run=run,
    )
    provenance = photo_provenance(
        photo,
        content,
        restoration,
        transfer=transfer,
        noisy=other,
        registration=given,
        finish=finish,
        mask=mask,
    )
    write_result(
        path,
        result,
        photo,
        mask,
        kernel,
        moving=kept,
        finish=finish,
        provenance=provenance,
        observer=observer,
        overwrite=overwrite,
        overwrite_others=overwrite_others,
        keep_result=keep_result,
        noisy=noisy,
    )
    return content


def in_linear_tones(photo: Photo, kernel: RotationKernel, *, run: Run = Run()) -> Photo:
    """Return a photo in the tones in which the kernel explains it.

    They are linear light, display values, or the light before a camera's tone curve. They are
    certain then: a part of the photo is deblurred in the same tones.
    """
    if not photo.may_be_toned:
        return photo
    grey = luminance(photo.pixels)
    tones = suited_tones(grey, kernel, photo.clipped, before_curve=light_before, run=run)
    if tones == "linear light":
        return photo.in_certain_light()
    _log.info("%s: the blur suits %s better than linear light", photo.source, tones)
    return photo.in_display_values() if tones == "display values" else photo.without_camera_curve()


def _assumed_camera(photo: Photo, pinhole: Camera, zoom: float) -> Camera:
    """Return the camera of a straight picture, with the focal length from the photo's tags."""
    camera = camera_for(photo, CameraChoice())[0].camera
    return Camera.from_focal(zoom * camera.focal_px, *pinhole.shape)


def _pair_restored(
    blurred: Photo,
    noisy: Photo,
    kernel: RotationKernel,
    options: RestorationOptions,
    *,
    registration: Registration,
    run: Run,
) -> Restoration:
    """Register the noisy photo, match its brightness to the blurred one, and deblur."""
    g, f_N = blurred.pixels, noisy.pixels
    if f_N.ndim != g.ndim:
        f_N = luminance(f_N) if g.ndim == 2 else np.repeat(f_N[..., None], g.shape[2], 2)
    stored = unclipped_mean(f_N)
    stored *= np.float32(registration.scale)
    f_reg, valid = registered(stored, registration)
    clipped = registered(noisy.clipped.astype(np.float32), registration)[0] > 0
    usable = (valid > 0) & ~(clipped | blurred.clipped)
    light = unclipped_mean(g)
    blur = ShakeBlur(kernel, run=run)
    Af = blurred_planes(channels_first(f_reg), blur)
    scale = fitted_factor(light, Af, usable, blur)
    Af *= np.float32(scale)
    pair: NoisyPhoto | None = None
    if not (blurred.is_sensors and noisy.is_sensors):
        mean = unclipped_mean(f_N)
        pair, trust = camera_pair(light, Af, mean, registration, blur, mask=usable, run=run)
        valid *= trust
    del Af, f_reg
    if pair is None:
        resample = partial(registered, registration=registration, margin=blur.margin)
        stored *= np.float32(scale)
        clipped = resample(noisy.clipped.astype(np.float32))[0] > 0
        pair, valid = noisy_photo(light, stored, resample, run=run)
    del stored
    method = METHODS[options.method]
    guides = {"valid": valid, "noisy_clipped": clipped}
    return method.load()(
        light,
        pair,
        kernel,
        clipped=blurred.clipped,
        run=run,
        **{name: guides[name] for name in method.inputs},
        **options.arguments(),
    )
