"""Lens distortion: removed before all other steps, and on demand applied again at the end.

Rotations are homographies only in the picture of a pinhole. So the photo of a camera with
distortion is straightened, in one resampling. All estimates and all deblurring work on the straight
picture. It has the size of the photo, and is as wide as possible without pixels from beyond the
photo: a barrel distortion loses its corners. The result is this picture, deblurred. If the geometry
is to be kept, the straight picture is wide enough for the whole photo; its mirror image fills the
rest. One more resampling then applies the distortion to the result.

Kernels and registrations are stored with the photo's camera and its distortion. From these, each
stage computes the same straight picture again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from deshake.errors import CalibrationError
from deshake.geometry.camera import Camera
from deshake.geometry.distortion import pinhole, undistorted
from deshake.lens.frame_tags import reframed
from deshake.lens.lens_warp import LensWarp
from deshake.metadata.provenance import carried_provenance

if TYPE_CHECKING:
    from deshake.formats.photo import Photo
    from deshake.geometry.kernel import RotationKernel

__all__ = [
    "bent",
    "bent_kernel",
    "camera_at",
    "check_unstraightened",
    "is_straightened",
    "straight_kernel",
    "straight_pair",
    "straight_region",
    "straightened",
]

Region = tuple[int, int, int, int]


def is_straightened(photo: Photo) -> bool:
    """Return whether the photo's provenance says that its distortion was removed already."""
    provenance = carried_provenance(photo.metadata)
    return provenance is not None and bool(provenance.get("straightened"))


def check_unstraightened(photo: Photo) -> None:
    """Refuse to remove the distortion of a photo a second time.

    Raises
    ------
    CalibrationError
        If it was removed already.

    """
    if is_straightened(photo):
        raise CalibrationError(
            "was straightened by deshake already",
            hint="leave --lens out, or use a camera or a kernel without distortion",
            file=photo.source,
        )


def straightened(photo: Photo, camera: Camera, *, whole: bool = False) -> tuple[Photo, Camera]:
    """Return the picture that a pinhole would have taken, and that pinhole.

    Parameters
    ----------
    photo : Photo
        The photo.
    camera : Camera
        Its camera; without distortion, photo and camera are returned unchanged.
    whole : bool, keyword-only
        Whether the picture shows all of the photo.

    Returns
    -------
    photo : Photo
        Pixels, clipped pixels and opacity are resampled; EXIF states the new frame.
    camera : Camera
        The pinhole, with the same principal point.

    Raises
    ------
    CalibrationError
        If the distortion is too strong, or the photo was straightened already.

    """
    if camera.is_pinhole:
        return photo, camera
    check_unstraightened(photo)
    straight_camera = _pinhole(photo, camera, whole=whole)
    warp = LensWarp(camera, straight_camera)
    straight = replace(
        photo,
        pixels=warp.straighten(photo.pixels),
        clipped=warp.straighten_mask(photo.clipped),
        alpha=None if photo.alpha is None else warp.straighten_codes(photo.alpha),
        metadata=reframed(photo.metadata, *straight_camera.shape, straight_camera.focal_px),
    )
    return straight, straight_camera


def bent(straight: Photo, photo: Photo, camera: Camera) -> Photo:
    """Return the whole straight picture bent to the geometry of its photo.

    Parameters
    ----------
    straight : Photo
        The result of `straightened` with `whole`.
    photo : Photo
        The photo: its opacity and metadata are kept.
    camera : Camera
        The photo's camera.

    """
    if camera.is_pinhole:
        return straight
    warp = LensWarp(camera, _pinhole(photo, camera, whole=True))
    return photo.with_pixels(warp.bend(straight.pixels))


def straight_pair(
    blurred: Photo, noisy: Photo, camera: Camera, *, whole: bool = False
) -> tuple[Photo, Photo, Camera]:
    """Return two photos through one lens as a pinhole would have taken them, and that pinhole.

    Parameters
    ----------
    blurred, noisy : Photo
        The photos; the noisy photo may be of another size, or lie on its side.
    camera : Camera
        The camera of the blurred photo.
    whole : bool, keyword-only
        As for `straightened`.

    """
    straight, straight_camera = straightened(blurred, camera, whole=whole)
    if camera.is_pinhole:
        return straight, noisy, straight_camera
    other, _ = straightened(noisy, camera_at(camera, noisy.shape), whole=whole)
    return straight, other, straight_camera


def straight_region(
    region: Region | None, camera: Camera, straight_camera: Camera
) -> Region | None:
    """Return the region of the straight picture that contains a region of the photo.

    Parameters
    ----------
    region : (x, y, width, height) or None
        In pixels of the photo.
    camera, straight_camera : Camera
        The photo's and the pinhole's.

    """
    if region is None or camera.is_pinhole:
        return region
    x, y, width, height = region
    corners = np.array(
        [(a, b) for a in (x, x + (width - 1) / 2, x + width - 1) for b in (y, y + height - 1)],
        np.float64,
    )
    straight_corners = undistorted(corners, camera, straight_camera)
    last = np.array(straight_camera.shape[::-1]) - 1
    low = np.clip(np.floor(straight_corners.min(0)), 0, last).astype(int)
    high = np.clip(np.ceil(straight_corners.max(0)), 0, last).astype(int)
    return int(low[0]), int(low[1]), int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1


def straight_kernel(
    kernel: RotationKernel, camera: Camera, straight_camera: Camera
) -> RotationKernel:
    """Return the kernel of a photo for its straight picture; see `bent_kernel`."""
    if camera.is_pinhole:
        return kernel
    if not kernel.camera.is_uniform:
        return kernel.for_camera(straight_camera)
    zoom = straight_camera.focal_px / camera.focal_px
    return kernel.for_camera(
        Camera.from_focal(zoom * kernel.camera.focal_px, *straight_camera.shape)
    )


def bent_kernel(kernel: RotationKernel, camera: Camera, straight_camera: Camera) -> RotationKernel:
    """Return the kernel of a straight picture with the camera of its photo.

    Rotations are the same for both. Those of the uniform model stand for shifts in pixels of the
    straight picture, and are scaled.

    Parameters
    ----------
    kernel : RotationKernel
        For the pinhole, or for the camera of the uniform model.
    camera, straight_camera : Camera
        The photo's and the pinhole's.

    """
    if camera.is_pinhole:
        return kernel
    if not kernel.camera.is_uniform:
        return kernel.for_camera(camera)
    zoom = straight_camera.focal_px / camera.focal_px
    return replace(
        kernel,
        theta=kernel.theta / zoom,
        steps=kernel.steps / zoom,
        camera=camera.as_uniform(),
    )


def camera_at(camera: Camera, shape: tuple[int, int]) -> Camera:
    """Return the camera of another photo through the same lens, of another size or turned.

    For a photo that lies on its side, the side is unknown: its principal point is assumed to be
    the middle.
    """
    height, width = shape
    if (height > width) == (camera.height > camera.width):
        return camera.scaled(height, width)
    focal = camera.focal_px * max(shape) / max(camera.shape)
    return Camera.from_focal(focal, height, width).with_lens(camera.distortion)


def _pinhole(photo: Photo, camera: Camera, *, whole: bool) -> Camera:
    try:
        return pinhole(camera, whole=whole)
    except ValueError as error:
        raise CalibrationError(
            f"the picture cannot be straightened: {error}",
            hint="try without the lens's distortion, or another camera file",
            file=photo.source,
        ) from error
