"""Shakes a sharp photo by a known camera path: for demos, tests and benchmarks.

The path itself blurs the photo, with an exact warp for each half pixel of its length. The kernel of
the result is the path, binned on the photo's grid.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deshake.errors import DeshakeError, OutputError
from deshake.files.disk import STREAM, check_output, sha256
from deshake.files.joint_outputs import joint_outputs
from deshake.files.kernel_file import KernelFile, kernel_bytes, read_camera
from deshake.formats.conversion import output_format
from deshake.formats.output_names import output_ending
from deshake.formats.photo import read_photo
from deshake.formats.photo_writing import photo_bytes
from deshake.geometry.distortion import bent_camera
from deshake.geometry.rotations import reach
from deshake.lens.frame_tags import reframed
from deshake.lens.lens_warp import LensWarp
from deshake.operators.warps import Warps
from deshake.run import Run
from deshake.simulation.exposure import expose
from deshake.simulation.shake_path import random_path, read_path
from deshake.stages.calibration import camera_for
from deshake.stages.camera_choice import CameraChoice
from deshake.stages.result_file import AS_THE_PHOTO, ResultFile
from deshake.version import __version__

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.formats.encoding import Format
    from deshake.formats.photo import Photo
    from deshake.formats.transfer import TransferName
    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel
    from deshake.simulation.shake_path import CameraPath

__all__ = ["Shaken", "ShakenPhoto", "shake", "shake_photo", "shaken_name", "simulate_file"]

_log = logging.getLogger(__name__)

Image = NDArray[np.float32]

_SMALLEST = 16  # pixels a side that cropping must leave


@dataclass(frozen=True, eq=False)
class Shaken:
    """A shaken photo, its sharp photo and its true kernel.

    Parameters
    ----------
    pixels : (h, w[, C]) array of float32
        The shaken photo, linear, 0..1.
    sharp : (h, w[, C]) array of float32
        The sharp photo in the same frame and exposure, linear; above 1 where it would clip.
    kernel : RotationKernel
        The path binned on the grid of the photo, its centroid at the origin.
    offset : (int, int)
        Row and column of the photo's first pixel in the original one.

    """

    pixels: Image
    sharp: Image
    kernel: RotationKernel
    offset: tuple[int, int]


def shake(
    pixels: Image,
    camera: Camera,
    path: CameraPath,
    *,
    crop: bool = True,
    gain: float = 1.0,
    photons: float | None = None,
    noise_sigma: float = 0.0,
    seed: int = 0,
    run: Run = Run(),
) -> Shaken:
    """Blur a photo by a camera path, apply the camera's distortion, and expose the photo.

    Parameters
    ----------
    pixels : (h, w[, C]) array of float32
        The sharp photo, linear light.
    camera : Camera
        Its camera. The sharp photo counts as a pinhole's. With a distortion, the shaken photo has
        the distortion of that lens; its focal length is longer, so that it shows no pixel from
        beyond the sharp photo.
    path : CameraPath
        How the camera turned; its centroid is moved to the origin first.
    crop : bool
        Whether to cut off the borders whose blur reaches beyond the photo, by the same width on all
        sides; else the edge pixels continue the photo, and it keeps its size.
    gain, photons, noise_sigma, seed
        As for `expose`.
    run : Run, optional
        Receives the progress.

    Raises
    ------
    ValueError
        If the photo does not fit the camera.
    DeshakeError
        If the path is too wide or too long, or nothing would be left after cropping.

    """
    if pixels.shape[:2] != camera.shape:
        raise ValueError(f"a photo of {pixels.shape[:2]} does not fit a camera of {camera.shape}")
    lens, camera = camera, replace(camera, distortion=np.zeros(0))
    path = path.centred(camera)
    theta, weights = path.pieces(camera)
    margin = reach(camera, theta)
    height, width = camera.shape
    if crop:
        if min(height, width) < 2 * margin + _SMALLEST:
            raise DeshakeError(
                f"a shake that reaches {margin} pixels leaves nothing of {width} x {height} pixels",
                hint="shake it less, or use --keep-size",
            )
        camera = camera.cropped(margin, margin, width - 2 * margin, height - 2 * margin)
        latent, sharp = pixels, pixels[margin:-margin, margin:-margin]
    else:
        around = ((margin, margin), (margin, margin), *[(0, 0)] * (pixels.ndim - 2))
        latent, sharp = np.pad(pixels, around, mode="edge"), pixels
    blurred = np.zeros(sharp.shape, np.float32)
    for k in range(len(theta)):
        warp = Warps(camera, theta[k : k + 1], margin=margin)
        blurred += warp.blur(latent, weights[k : k + 1])
        run.report((k + 1) / (len(theta) + 1), "shaking")
    kernel = path.kernel(camera)
    if not lens.is_pinhole:
        bent = _bent_camera(camera, lens)
        lens_warp = LensWarp(bent, camera)
        blurred, sharp = lens_warp.bend(blurred), lens_warp.bend(sharp)
        kernel = kernel.for_camera(bent)
    expose(blurred, gain=gain, photons=photons, noise_sigma=noise_sigma, seed=seed)
    offset = (margin, margin) if crop else (0, 0)
    return Shaken(blurred, sharp * np.float32(gain), kernel, offset)


def _bent_camera(camera: Camera, lens: Camera) -> Camera:
    try:
        return bent_camera(camera, lens.distortion)
    except ValueError as error:
        raise DeshakeError(f"the lens cannot be simulated: {error}") from error


@dataclass(frozen=True, eq=False)
class ShakenPhoto:
    """A shaken photo as a `Photo`, with its sharp photo and its true kernel.

    Parameters
    ----------
    photo : Photo
        The shaken photo; its EXIF describes its frame.
    sharp : Photo
        The sharp photo in the same frame and exposure; above 1 where it would clip.
    kernel : RotationKernel
        As in `Shaken`.

    """

    photo: Photo
    sharp: Photo
    kernel: RotationKernel


def shake_photo(photo: Photo, camera: Camera, path: CameraPath, **options: Any) -> ShakenPhoto:  # noqa: ANN401
    """Shake a photo, its opacity and its EXIF; parameters and errors are those of `shake`."""
    result = shake(photo.pixels, camera, path, **options)
    top, left = result.offset
    height, width = result.pixels.shape[:2]
    inside = slice(top, top + height), slice(left, left + width)
    frame_camera = result.kernel.camera
    alpha = None if photo.alpha is None else np.ascontiguousarray(photo.alpha[inside])
    if alpha is not None and not frame_camera.is_pinhole:
        whole = camera.cropped(left, top, width, height)
        alpha = LensWarp(frame_camera, replace(whole, distortion=np.zeros(0))).bend_codes(alpha)
    framed = replace(
        photo,
        pixels=result.pixels,
        clipped=_at_white(result.pixels),
        alpha=alpha,
        metadata=reframed(photo.metadata, height, width, frame_camera.focal_px),
        frame=None,
        sha256=None,
    )
    sharp = replace(framed, pixels=result.sharp, clipped=_at_white(result.sharp))
    return ShakenPhoto(framed, sharp, result.kernel)


def _at_white(pixels: Image) -> NDArray[np.bool_]:
    """Return where any channel is at white."""
    white = pixels >= 1
    return white if pixels.ndim == 2 else np.any(white, axis=-1)


def shaken_name(source: Path, form: Format | None = None) -> Path:
    """Return the default name of a shaken photo: ``<stem>.shaken.<ext>`` beside the sharp one."""
    ending = source.suffix if form is None else output_ending(source, form)
    return source.with_name(f"{source.stem}.shaken{ending}")


def simulate_file(
    source: Path,
    output: Path | None,
    *,
    kernel: Path | None = None,
    sharp: Path | None = None,
    path: Path | None = None,
    blur_px: float = 20.0,
    seed: int = 0,
    crop: bool = True,
    gain: float = 1.0,
    photons: float | None = None,
    noise_sigma: float = 0.0,
    focal_px: float | None = None,
    focal_35mm: float | None = None,
    lens: bool | None = None,
    lens_model: str | None = None,
    camera: Path | None = None,
    transfer: TransferName | None = None,
    file: ResultFile = AS_THE_PHOTO,
    overwrite: bool = False,
    run: Run = Run(),
) -> None:
    """Shake a photo file; write the shaken photo and its true kernel.

    Parameters
    ----------
    source : Path
        The sharp photo.
    output : Path, optional
        The shaken one; by default ``<stem>.shaken.<ext>`` beside the sharp one.
    kernel : Path, optional
        The true kernel, ``-`` for standard output; by default the output's name with ``.npz``.
    sharp : Path, optional
        File for the sharp photo in the frame of the shaken one; by default none is written.
    path : Path, optional
        A camera path (`read_path`); by default `random_path` with `blur_px` and `seed`.
    crop, gain, photons, noise_sigma, seed
        As for `shake`.
    focal_px, focal_35mm, camera
        The focal length in pixels or 35 mm equivalents, or a camera file; by default the photo's
        metadata state it, else a 50 mm equivalent is assumed. A camera file may have distortion.
    lens, lens_model
        Whether to apply the distortion of the photo's lens, or the name of a lens to use instead.
    transfer : {"linear", "srgb", "gamma22"}, optional
        As for `read_photo`.
    file : ResultFile
        Format of the shaken photo, and quality of a JPEG.
    overwrite : bool
        Whether existing outputs may be replaced.
    run : Run, optional
        Receives the progress.

    Raises
    ------
    DeshakeError
        If a file cannot be read or written, or the photo is too small for the shake.

    """
    output = output or shaken_name(source, file.form)
    kernel = kernel or output.with_suffix(".npz")
    outputs = [item for item in (output, kernel, sharp) if item is not None]
    inputs = [item for item in (source, path, camera) if item is not None]
    for number, item in enumerate(outputs):
        check_output(item, *inputs, overwrite=overwrite)
        if item.absolute() in [other.absolute() for other in outputs[:number]]:
            raise OutputError("two outputs of this name", hint="name them apart", file=item)
    photo = file.encoded(read_photo(source, transfer=transfer))
    form = file.format_of(output, photo)
    if sharp is not None:
        output_format(sharp, photo.source, photo.encoding)
    choice = CameraChoice(
        focal_px=focal_px,
        focal_35mm=focal_35mm,
        lens=lens,
        lens_model=lens_model,
        file=None if camera is None else read_camera(camera),
    )
    camera_file, notes = camera_for(photo, choice)
    for note in notes:
        _log.warning("%s: %s", photo.source, note)
    try:
        result = shake_photo(
            photo,
            camera_file.camera,
            read_path(path) if path else random_path(camera_file.camera, blur_px, seed=seed),
            crop=crop,
            gain=gain,
            photons=photons,
            noise_sigma=noise_sigma,
            seed=seed,
            run=run,
        )
    except DeshakeError as error:
        error.file = error.file or str(source)
        raise
    drawn = {"path_sha256": sha256(path)} if path else {"blur_px": blur_px}
    exposed = {"gain": gain, "photons": photons, "noise": noise_sigma}
    provenance = {
        "deshake": __version__,
        "command": "simulate",
        "options": drawn
        | exposed
        | {"seed": seed, "crop": crop, "transfer": transfer}
        | file.provenance(),
        "input_sha256": photo.sha256,
        "camera": camera_file.source,
    }
    content = KernelFile(result.kernel, provenance=provenance)
    with joint_outputs(photo.source) as add:
        add(output, photo_bytes(output, result.photo, form), overwrite=overwrite)
        if sharp is not None:
            add(sharp, photo_bytes(sharp, result.sharp), overwrite=overwrite)
        add(kernel, kernel_bytes(content), overwrite=overwrite)
    if str(kernel) != STREAM:
        extent = result.kernel.extent_px()
        height, width = result.photo.shape
        _log.info("%s: %d x %d pixels, blur of %.1f pixels", output, width, height, extent)
