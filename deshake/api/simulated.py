"""Shaken pictures whose kernel is known."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

import numpy as np

from deshake.api.arguments import check_above_zero
from deshake.api.cameras import chosen_camera
from deshake.api.pictures_in import as_photo
from deshake.errors import DeshakeError
from deshake.formats.photo import Photo
from deshake.run import Progress, Run
from deshake.simulation.shake_path import CameraPath, random_path
from deshake.simulation.shaken_photo import shake_photo
from deshake.stages.calibration import camera_for

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from deshake.api.pictures_in import Array, Picture
    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel


__all__ = ["Simulation", "simulate"]

_log = logging.getLogger(__name__)

P_co = TypeVar("P_co", bound="Photo | NDArray[np.float32]", covariant=True)


@dataclass(frozen=True, eq=False)
class Simulation(Generic[P_co]):
    """A shaken picture, with its true kernel and its sharp picture.

    Parameters
    ----------
    blurred : Photo, or (h, w) or (h, w, 3) array of float32
        The shaken picture, linear light, 0..1.
    sharp : Photo, or (h, w) or (h, w, 3) array of float32
        The sharp picture in the same frame and exposure; above 1 where it would clip.
    kernel : RotationKernel
        The true kernel of `blurred`, with the camera of its frame.

    """

    blurred: P_co
    sharp: P_co
    kernel: RotationKernel


@overload
def simulate(
    photo: Photo,
    camera: Camera | None = None,
    *,
    path: ArrayLike | None = None,
    blur_px: float = 20.0,
    crop: bool = True,
    gain: float = 1.0,
    photons: float | None = None,
    noise_sigma: float = 0.0,
    seed: int = 0,
    progress: Progress | None = None,
) -> Simulation[Photo]: ...
@overload
def simulate(
    photo: Array,
    camera: Camera | None = None,
    *,
    path: ArrayLike | None = None,
    blur_px: float = 20.0,
    crop: bool = True,
    gain: float = 1.0,
    photons: float | None = None,
    noise_sigma: float = 0.0,
    seed: int = 0,
    progress: Progress | None = None,
) -> Simulation[NDArray[np.float32]]: ...
def simulate(
    photo: Picture,
    camera: Camera | None = None,
    *,
    path: ArrayLike | None = None,
    blur_px: float = 20.0,
    crop: bool = True,
    gain: float = 1.0,
    photons: float | None = None,
    noise_sigma: float = 0.0,
    seed: int = 0,
    progress: Progress | None = None,
) -> Simulation[Any]:
    """Shake a sharp photo by a known rotation of the camera.

    ``deshake simulate`` gives the same picture. The light is blurred by Eq. (7) of [1]_, at every
    half pixel of the camera's path, then exposed with noise and clipping.

    Parameters
    ----------
    photo : Photo, or (H, W) or (H, W, 3) array of float
        The sharp photo in linear light.
    camera : Camera, optional
        Its camera; by default as for `estimate_blind`. If the camera has a distortion, the photo is
        taken as straight, and is distorted after the shake.
    path : (T, 3) array, optional
        Successive orientations of the camera as angle-axis vectors in radians, about X (right), Y
        (down) and Z (into the scene), at equal times; by default a random path.
    blur_px : float
        Extent of the random blur over the frame, in pixels, > 0.
    crop : bool
        Whether to cut off the borders whose blur reaches beyond the photo. Otherwise the photo is
        continued by its edge pixels.
    gain : float
        Factor on the light after the blur, > 0.
    photons : float, optional
        Photons that fill a pixel to the clip level, > 0; by default no shot noise.
    noise_sigma : float
        Standard deviation of the read noise as a share of the clip level, 0..1.
    seed : int
        Seed of the random path and of the noise, >= 0.
    progress : callable, optional
        Receives the share of the work that is done, 0..1, and a text.

    Returns
    -------
    Simulation
        With ``blurred``, ``sharp`` (photos or arrays, as `photo`) and ``kernel``.

    Raises
    ------
    PhotoError
        If the array is not a picture in linear light.
    KernelFileError
        If the camera is for pictures of other proportions.
    DeshakeError
        If the path is too wide or too long, or nothing would be left after cropping.
    ValueError
        If an option is out of range, or the path is not a (T, 3) array of finite angles.

    References
    ----------
    .. [1] O. Whyte, J. Sivic, A. Zisserman, J. Ponce, "Non-uniform deblurring for shaken images",
       CVPR 2010, DOI 10.1109/CVPR.2010.5540175

    Examples
    --------
    >>> import numpy as np
    >>> import deshake
    >>> sharp = np.random.default_rng(0).random((8, 10)).repeat(8, 0).repeat(8, 1)
    >>> camera = deshake.Camera.from_focal(80.0, *sharp.shape)
    >>> turn = np.array([(0, -0.02, 0), (0, 0.02, 0)])  # about the vertical axis
    >>> shaken = deshake.simulate(sharp, camera, path=turn)
    >>> shaken.blurred.shape == shaken.sharp.shape == shaken.kernel.camera.shape
    True
    >>> bool(shaken.blurred.std() < shaken.sharp.std())
    True

    """
    check_above_zero(blur_px=blur_px, gain=gain, photons=photons)
    if not 0 <= noise_sigma <= 1:
        raise ValueError(f"noise_sigma is {noise_sigma!r}: it must be from 0 to 1")
    if seed < 0:
        raise ValueError(f"seed is {seed!r}: it must be at least 0")
    given = as_photo(photo)
    content, notes = camera_for(given, chosen_camera(camera))
    for note in notes:
        _log.warning("%s: %s", given.source, note)
    photo_camera = content.camera
    try:
        shaken = shake_photo(
            given,
            photo_camera,
            random_path(photo_camera, blur_px, seed=seed)
            if path is None
            else CameraPath(np.asarray(path, np.float64)),
            crop=crop,
            gain=gain,
            photons=photons,
            noise_sigma=noise_sigma,
            seed=seed,
            run=Run(progress=progress),
        )
    except DeshakeError as error:
        error.file = error.file or str(given.source)
        raise
    if isinstance(photo, Photo):
        return Simulation(shaken.photo, shaken.sharp, shaken.kernel)
    return Simulation(shaken.photo.pixels, shaken.sharp.pixels, shaken.kernel)
