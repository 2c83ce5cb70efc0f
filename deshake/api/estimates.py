"""Estimates: the kernel of one photo, or of a blurred and a noisy one."""

from __future__ import annotations

import logging
from numbers import Integral
from typing import TYPE_CHECKING, get_args

from deshake.api.arguments import check_above_zero, check_kind, check_share
from deshake.api.cameras import chosen_camera
from deshake.api.linear_algebra import one_linear_thread
from deshake.api.pictures_in import NOISY_ARRAY, as_photo
from deshake.blind.estimate import Estimator
from deshake.formats.photo import balanced
from deshake.pair.registration import Registration
from deshake.run import Progress, Run
from deshake.stages.blind_estimate import estimate_blind as estimate_from_photo
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.pair_estimate import estimate_pair as estimate_from_photos
from deshake.stages.registering import find_registration

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.api.pictures_in import Picture
    from deshake.formats.photo import Photo
    from deshake.geometry.camera import Camera
    from deshake.stages.estimate_result import Estimate


__all__ = ["estimate_blind", "estimate_pair", "register"]

_log = logging.getLogger(__name__)

_WIDEST_DEGREES = 45.0  # degrees: a larger angle is an error


@one_linear_thread()
def estimate_blind(
    photo: Picture,
    camera: Camera | None = None,
    *,
    blur_size: float | None = None,
    max_angle: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    least_confidence: float | None = None,
    uniform: bool = False,
    estimator: Estimator = "edges",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Estimate the blur kernel of a photo from the photo alone.

    ``deshake estimate-blind`` gives the same kernel. A sharp photo, or one that no kernel improves,
    gets the kernel of a camera that stood still, and a note says so.

    Parameters
    ----------
    photo : Photo, or (H, W) or (H, W, 3) array of float
        The photo in linear light, 1 where it clips; at least 48 pixels a side.
    camera : Camera, optional
        Its camera; one for another size of the same proportions is scaled. By default the camera
        of the photo's metadata, else a focal length that is estimated with the kernel, with a note.
    blur_size : float, optional
        Largest blur to look for, in pixels of the photo, from 1 to half the shorter side.
    max_angle : float, optional
        The same as an angle: the widest shake about any axis, in degrees, above 0 up to 45.
    region : (int, int, int, int), optional
        The part of the photo to use: x, y, width and height in pixels.
    least_confidence : float, optional
        Confidence, 0..1, with which a kernel of "edges" is kept, whatever the photo looks like; 0
        keeps any. By default it is 0.5, or 0.8 if the photo has the edges of a sharp one, and
        photos that look sharp or soft get the kernel of a still camera.
    uniform : bool
        Whether to assume the same blur all over the frame.
    estimator : {"edges", "variational"}
        Sharp edges of tiles, or the inference of [1]_.
    threads : int, optional
        Threads to use; by default all processors. The result does not depend on it.
    progress : callable, optional
        Receives the share of the work that is done, 0..1, and a text.

    Returns
    -------
    Estimate
        With ``kernel``, ``confidence`` (0..1) and ``notes``.

    Raises
    ------
    PhotoError
        If the array is not a picture in linear light, or the region lies outside the photo.
    KernelFileError
        If the camera is for pictures of other proportions.
    EstimationError
        If the photo is too small, too flat or too much clipped, or the largest blur does not fit.
    ValueError
        If an option is out of range.

    References
    ----------
    .. [1] O. Whyte, J. Sivic, A. Zisserman, J. Ponce, "Non-uniform deblurring for shaken images",
       CVPR 2010, DOI 10.1109/CVPR.2010.5540175

    Examples
    --------
    >>> import numpy as np
    >>> import deshake
    >>> sharp = np.random.default_rng(0).random((12, 15)).repeat(10, 0).repeat(10, 1)
    >>> camera = deshake.Camera.from_focal(150.0, *sharp.shape)
    >>> shaken = deshake.simulate(sharp, camera, blur_px=6, seed=1)
    >>> blur = deshake.estimate_blind(shaken.blurred, shaken.kernel.camera, blur_size=8)
    >>> 0.5 < blur.confidence <= 1
    True
    >>> 3 < blur.kernel.extent_px() < 15
    True

    """
    if estimator not in get_args(Estimator):
        raise ValueError(f"no estimator {estimator!r}: {' or '.join(get_args(Estimator))}")
    _check_bounds(blur_size, max_angle)
    check_share(least_confidence=least_confidence)
    if least_confidence is not None and estimator != "edges":
        raise ValueError("a least confidence needs the estimator 'edges'")
    if region is not None and not _is_region(region):
        raise ValueError(f"a region is x, y, width and height in pixels, not {region!r}")
    options = EstimateOptions(
        chosen_camera(camera),
        blur_size=blur_size,
        max_angle=max_angle,
        region=region,
        least_confidence=least_confidence,
        uniform=uniform,
        estimator=estimator,
    )
    return estimate_from_photo(as_photo(photo), options, run=Run(threads, progress))


@one_linear_thread()
def register(
    blurred: Picture,
    noisy: Picture,
    camera: Camera | None = None,
    *,
    search_angle: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Registration:
    """Register a noisy, sharp photo to a blurred one of the same scene (Sec. 6 of [1]_).

    ``deshake register`` gives the same registration. Assumptions about the camera are logged as
    warnings.

    Parameters
    ----------
    blurred : Photo, or (H, W) or (H, W, 3) array of float
        The blurred photo in linear light, 1 where it clips.
    noisy : Photo, or (h, w) or (h, w, 3) array of float
        The noisy photo, of the same proportions or turned by 90 degrees, at any size.
    camera : Camera, optional
        The camera of the blurred photo; by default as for `estimate_blind`.
    search_angle : float, optional
        Largest rotation about any axis between the two photos, in degrees, above 0 up to 45; by
        default 10.
    threads : int, optional
        Threads to use; by default all processors.
    progress : callable, optional
        Receives the share of the work that is done, 0..1, and a text.

    Returns
    -------
    Registration
        With ``theta`` (3 angles in radians), ``scale`` (the factor between the exposures),
        ``confidence`` (0.5..1) and ``camera``.

    Raises
    ------
    EstimationError
        If the photos do not show the same scene, or have different proportions.
    PhotoError
        If an array is not a picture in linear light, or the metadata of the two photos have
        different focal lengths.
    KernelFileError
        If the camera is for pictures of other proportions.
    ValueError
        If the angle is out of range.

    References
    ----------
    .. [1] O. Whyte, J. Sivic, A. Zisserman, J. Ponce, "Non-uniform deblurring for shaken images",
       CVPR 2010, DOI 10.1109/CVPR.2010.5540175

    Examples
    --------
    >>> import numpy as np
    >>> import deshake
    >>> scene = np.random.default_rng(0).random((12, 16)).repeat(8, 0).repeat(8, 1)
    >>> camera = deshake.Camera.from_focal(120.0, *scene.shape)
    >>> match = deshake.register(scene, 0.25 * scene, camera, search_angle=2)
    >>> round(match.scale, 2), bool(abs(match.theta).max() < 0.001)
    (4.0, True)

    """
    check_above_zero(most=_WIDEST_DEGREES, search_angle=search_angle)
    long_exposure, short_exposure = _pair(blurred, noisy)
    match = find_registration(
        long_exposure,
        short_exposure,
        EstimateOptions(chosen_camera(camera), search_angle=search_angle),
        run=Run(threads, progress),
    )
    for note in match.notes:
        _log.warning("%s: %s", long_exposure.source, note)
    return match.registration


@one_linear_thread()
def estimate_pair(
    blurred: Picture,
    noisy: Picture,
    camera: Camera | None = None,
    *,
    registration: Registration | None = None,
    blur_size: float | None = None,
    max_angle: float | None = None,
    least_confidence: float | None = None,
    uniform: bool = False,
    search_angle: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Estimate the blur kernel of a photo with the help of a noisy one (Sec. 6 of [1]_).

    ``deshake estimate-pair`` gives the same kernel. Where the two photos agree too badly, the
    kernel is that of a camera that stood still, and a note says so.

    Parameters
    ----------
    blurred : Photo, or (H, W) or (H, W, 3) array of float
        The blurred photo in linear light, 1 where it clips; at least 48 pixels a side.
    noisy : Photo, or (h, w) or (h, w, 3) array of float
        The noisy photo, of the same proportions or turned by 90 degrees, at any size.
    camera : Camera, optional
        The camera of the blurred photo; by default as for `estimate_blind`. A registration has its
        own camera, and takes no other.
    registration : Registration, optional
        What `register` returned for the two; by default they are registered.
    blur_size, max_angle : float, optional
        Largest blur to look for, in pixels or in degrees, as for `estimate_blind`.
    least_confidence : float, optional
        Confidence, 0..1, with which the kernel is kept; by default 0.5.
    uniform : bool
        Whether to assume the same blur all over the frame.
    search_angle : float, optional
        As for `register`.
    threads : int, optional
        Threads to use; by default all processors.
    progress : callable, optional
        Receives the share of the work that is done, 0..1, and a text.

    Returns
    -------
    Estimate
        With ``kernel`` (in the frame of the registered noisy photo), ``confidence`` (0..1),
        ``notes``, ``registration`` and ``trusted``.

    Raises
    ------
    EstimationError
        If the photos do not show the same scene, or are too small, too flat or too much clipped.
    PhotoError
        If an array is not a picture in linear light, or the metadata of the two photos have
        different focal lengths.
    KernelFileError
        If the camera or the registration is for pictures of another size.
    ValueError
        If an option is out of range, or both a camera and a registration are given.

    References
    ----------
    .. [1] O. Whyte, J. Sivic, A. Zisserman, J. Ponce, "Non-uniform deblurring for shaken images",
       CVPR 2010, DOI 10.1109/CVPR.2010.5540175

    Examples
    --------
    >>> import numpy as np
    >>> import deshake
    >>> sharp = np.random.default_rng(0).random((12, 16)).repeat(8, 0).repeat(8, 1)
    >>> camera = deshake.Camera.from_focal(120.0, *sharp.shape)
    >>> shaken = deshake.simulate(sharp, camera, blur_px=4, seed=1)
    >>> noisy = 0.25 * shaken.sharp + np.random.default_rng(1).normal(0, 0.01, shaken.sharp.shape)
    >>> match = deshake.register(shaken.blurred, noisy, shaken.kernel.camera, search_angle=2)
    >>> blur = deshake.estimate_pair(shaken.blurred, noisy, registration=match, blur_size=8)
    >>> blur.trusted, blur.confidence > 0.9
    (True, True)

    """
    _check_bounds(blur_size, max_angle)
    check_above_zero(most=_WIDEST_DEGREES, search_angle=search_angle)
    check_share(least_confidence=least_confidence)
    if registration is not None:
        check_kind(registration, Registration, "register returns the registration of two photos")
        if camera is not None:
            raise ValueError("a registration has its camera: leave the camera out")
    options = EstimateOptions(
        chosen_camera(camera),
        blur_size=blur_size,
        max_angle=max_angle,
        least_confidence=least_confidence,
        uniform=uniform,
        search_angle=search_angle,
    )
    return estimate_from_photos(
        *_pair(blurred, noisy),
        options,
        registration=registration,
        run=Run(threads, progress),
    )


def _pair(blurred: Picture, noisy: Picture) -> tuple[Photo, Photo]:
    """Return both pictures as photos in one white balance."""
    reference = as_photo(blurred)
    return reference, balanced(as_photo(noisy, NOISY_ARRAY), reference)


def _check_bounds(blur_size: float | None, max_angle: float | None) -> None:
    check_above_zero(blur_size=blur_size)
    check_above_zero(most=_WIDEST_DEGREES, max_angle=max_angle)
    if blur_size is not None and max_angle is not None:
        raise ValueError("blur_size and max_angle cannot both be given")


def _is_region(region: Sequence[object]) -> bool:
    whole = [number for number in region if isinstance(number, Integral)]
    if len(whole) != 4 or len(region) != 4:
        return False
    x, y, width, height = map(int, whole)
    return min(x, y) >= 0 and min(width, height) >= 1
