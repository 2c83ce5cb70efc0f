"""Deblurring: a photo without its blur."""

from __future__ import annotations

from typing import TYPE_CHECKING, overload

from deshake.api.arguments import check_above_zero, check_kind
from deshake.api.linear_algebra import one_linear_thread
from deshake.api.pictures_in import NOISY_ARRAY, as_photo, pixels_of
from deshake.files.kernel_file import KernelFile
from deshake.formats.photo import Photo, balanced
from deshake.geometry.kernel import RotationKernel
from deshake.pair.registration import Registration
from deshake.run import Progress, Run
from deshake.stages.deblurring import deblur as deblur_photo
from deshake.stages.fitting import check_registration, fitting_kernel
from deshake.stages.methods import RestorationOptions, default_method

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from deshake.api.pictures_in import Array, Picture
    from deshake.restore.quality import Quality


__all__ = ["deblur"]


@overload
def deblur(
    photo: Photo,
    kernel: RotationKernel,
    *,
    noisy: Picture | None = None,
    registration: Registration | None = None,
    method: str | None = None,
    quality: Quality = "default",
    iterations: int | None = None,
    search_angle: float | None = None,
    keep_geometry: bool = False,
    protect_moving: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Photo: ...
@overload
def deblur(
    photo: Array,
    kernel: RotationKernel,
    *,
    noisy: Picture | None = None,
    registration: Registration | None = None,
    method: str | None = None,
    quality: Quality = "default",
    iterations: int | None = None,
    search_angle: float | None = None,
    keep_geometry: bool = False,
    protect_moving: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> NDArray[np.float32]: ...
@one_linear_thread()
def deblur(
    photo: Picture,
    kernel: RotationKernel,
    *,
    noisy: Picture | None = None,
    registration: Registration | None = None,
    method: str | None = None,
    quality: Quality = "default",
    iterations: int | None = None,
    search_angle: float | None = None,
    keep_geometry: bool = False,
    protect_moving: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Picture:
    """Deblur a photo whose kernel is known, alone or with a noisy photo of the same scene.

    ``deshake deblur`` gives the same picture. The kernel of a camera that stood still leaves the
    photo unchanged. A `Photo` whose display values suit the kernel better than its linear light,
    because of a tone curve, is deblurred in them; its result is in linear light, too.

    Parameters
    ----------
    photo : Photo, or (H, W) or (H, W, 3) array of float
        The blurred photo in linear light, 1 where it clips.
    kernel : RotationKernel
        Its blur, such as ``estimate_blind(photo).kernel``; one for another size of the same
        proportions is scaled.
    noisy : Photo, or (h, w) or (h, w, 3) array of float, optional
        A noisy, sharp photo of the same scene.
    registration : Registration, optional
        What `register` returned for the two; by default they are registered.
    method : str, optional
        By default ``"sparse"``, sparse gradients; with a noisy photo ``"fusion"``, both photos in
        one energy. Others are ``"rl"``, ``"rl-accelerated"`` and ``"rl-tv"`` (Richardson-Lucy,
        Eq. (11) of [1]_), ``"wiener"`` and ``"unsupervised-wiener"`` for uniform blur, and with a
        noisy photo ``"residual"`` [2]_.
    quality : {"fast", "default", "high"}
        How much time sparse gradients and the fusion take.
    iterations : int, optional
        Number of iterations, >= 1; by default one that suits the method and the photo.
    search_angle : float, optional
        As for `register`; used if there is no registration.
    keep_geometry : bool
        Whether the result keeps the distortion of the photo's lens, if there is any. By default the
        result is straight.
    protect_moving : bool
        Whether the result keeps the photo where its blur is not that of the camera, because
        something moved.
    threads : int, optional
        Threads to use; by default all processors.
    progress : callable, optional
        Receives the share of the work that is done, 0..1, and a text.

    Returns
    -------
    Photo, or array of float32
        As `photo`: a `Photo` with the same format and metadata, or an array in linear light of the
        same shape, not clipped to 0..1. If the camera has a distortion, the shape may differ.

    Raises
    ------
    PhotoError
        If an array is not a picture in linear light.
    KernelFileError
        If the kernel is for pictures of other proportions, the registration is for another size, or
        the blur is wider than half of the frame.
    CalibrationError
        If the lens's distortion is too strong to be undone.
    EstimationError
        If the two photos do not show the same scene.
    DeshakeError
        If the method is for uniform blur only, and the blur varies over the frame.
    ValueError
        If an option is unknown, out of range or does not go with the others.

    References
    ----------
    .. [1] O. Whyte, J. Sivic, A. Zisserman, J. Ponce, "Non-uniform deblurring for shaken images",
       CVPR 2010, DOI 10.1109/CVPR.2010.5540175
    .. [2] L. Yuan, J. Sun, L. Quan, H.-Y. Shum, "Image deblurring with blurred/noisy image pairs",
       SIGGRAPH 2007, DOI 10.1145/1276377.1276379

    Examples
    --------
    >>> import numpy as np
    >>> import deshake
    >>> sharp = np.random.default_rng(0).random((8, 10)).repeat(8, 0).repeat(8, 1)
    >>> camera = deshake.Camera.from_focal(80.0, *sharp.shape)
    >>> shaken = deshake.simulate(sharp, camera, blur_px=4, seed=1)
    >>> result = deshake.deblur(shaken.blurred, shaken.kernel)
    >>> result.shape == shaken.blurred.shape, result.dtype
    (True, dtype('float32'))
    >>> error = [float(abs(array - shaken.sharp).mean()) for array in (shaken.blurred, result)]
    >>> error[1] < error[0] / 2
    True

    """
    check_kind(kernel, RotationKernel, "estimate_blind(photo).kernel is one")
    check_above_zero(most=45, search_angle=search_angle)
    if iterations is not None and iterations < 1:
        raise ValueError(f"iterations is {iterations!r}: it must be at least 1")
    options = RestorationOptions(
        method or default_method(noisy=noisy is not None), quality, iterations
    )
    given = as_photo(photo)
    other = None if noisy is None else balanced(as_photo(noisy, NOISY_ARRAY), given)
    if registration is not None:
        check_kind(registration, Registration, "register returns the registration of two photos")
        if other is None:
            raise ValueError("a registration needs the noisy photo")
        check_registration(registration.camera, given)
    result = deblur_photo(
        given,
        fitting_kernel(KernelFile(kernel), given),
        options,
        noisy=other,
        registration=registration,
        search_angle=search_angle,
        keep_geometry=keep_geometry,
        protect_moving=protect_moving,
        run=Run(threads, progress),
    ).photo
    return result if isinstance(photo, Photo) else pixels_of(result, photo)
