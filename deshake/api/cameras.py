"""The camera of a picture: from the picture itself, or from the caller."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from deshake.api.arguments import check_above_zero, check_kind
from deshake.api.pictures_in import as_photo
from deshake.files.kernel_file import CameraFile
from deshake.geometry.camera import Camera
from deshake.lens.straightening import check_unstraightened
from deshake.stages.calibration import calibrate as calibrate_photo
from deshake.stages.camera_choice import CameraChoice

if TYPE_CHECKING:
    from deshake.api.pictures_in import Picture

__all__ = ["calibrate", "chosen_camera"]

_log = logging.getLogger(__name__)

_SOURCE = "the camera that was given"


def calibrate(
    photo: Picture,
    *,
    focal_px: float | None = None,
    focal_35mm: float | None = None,
    lens: bool = False,
    lens_model: str | None = None,
) -> Camera:
    """Return the camera of a photo: its focal length, and its lens's distortion on request.

    The principal point is the middle of the frame (Sec. 2.2 of [1]_). ``deshake calibrate`` gives
    the same camera. Doubts about it are logged as warnings.

    Parameters
    ----------
    photo : Photo, or (H, W) or (H, W, 3) array of float
        The photo, upright. An array has no metadata: it needs a focal length.
    focal_px : float, optional
        Focal length in pixels of the photo, > 0, instead of the one in the metadata.
    focal_35mm : float, optional
        Focal length in millimetres on 35 mm film, > 0, instead of the one in the metadata.
    lens : bool
        Whether the lens's distortion is looked up in lensfun's database, by EXIF.
    lens_model : str, optional
        The lens's name in that database, instead of the one in EXIF.

    Returns
    -------
    Camera
        For pictures of the photo's size.

    Raises
    ------
    CalibrationError
        If neither the arguments nor the metadata have the focal length, or if the lens is unknown
        or was straightened already.
    PhotoError
        If the array is not a picture in linear light.
    ValueError
        If two focal lengths are given, or one is not above 0.

    References
    ----------
    .. [1] O. Whyte, J. Sivic, A. Zisserman, J. Ponce, "Non-uniform deblurring for shaken images",
       CVPR 2010, DOI 10.1109/CVPR.2010.5540175

    Examples
    --------
    >>> import numpy as np
    >>> import deshake
    >>> camera = deshake.calibrate(np.full((480, 720), 0.2), focal_35mm=50)
    >>> camera.shape, round(camera.focal_px)
    ((480, 720), 1000)

    """
    check_above_zero(focal_px=focal_px, focal_35mm=focal_35mm)
    if focal_px is not None and focal_35mm is not None:
        raise ValueError("focal_px and focal_35mm cannot both be given")
    given = as_photo(photo)
    if lens or lens_model is not None:
        check_unstraightened(given)
    calibration = calibrate_photo(
        given, focal_px=focal_px, focal_35mm=focal_35mm, lens=lens, lens_model=lens_model
    )
    for note in calibration.notes:
        _log.warning("%s: %s", given.source, note)
    return calibration.camera


def chosen_camera(camera: Camera | None) -> CameraChoice:
    """Return the choice of a camera; None: the photo's metadata decide."""
    if camera is None:
        return CameraChoice()
    check_kind(camera, Camera, "calibrate returns the camera of a photo")
    return CameraChoice(file=CameraFile(camera, _SOURCE))
