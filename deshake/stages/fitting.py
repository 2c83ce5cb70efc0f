"""Fit a kernel or a camera to a photo, which may be resized; check registrations and regions."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.errors import KernelFileError, PhotoError
from deshake.geometry.rotations import displacements, homographies

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.files.kernel_file import CameraFile, KernelFile
    from deshake.formats.photo import Photo
    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel

__all__ = [
    "check_region",
    "check_registration",
    "fitting_camera",
    "fitting_kernel",
    "same_proportions",
]

_WIDEST_TURN: Final = math.radians(45)  # radians: largest range of rotations about an axis
_WIDEST_BLUR: Final = 0.5  # share of the longer side


def fitting_kernel(content: KernelFile, photo: Photo, file: Path | None = None) -> RotationKernel:
    """Return a kernel for a photo, which may have another size than the kernel's own photo.

    Parameters
    ----------
    content : KernelFile
        The kernel.
    photo : Photo
        The photo.
    file : Path, optional
        The kernel's file, for messages.

    Raises
    ------
    KernelFileError
        If the photo has other proportions, or the blur is absurdly wide for it.

    """
    kernel = content.kernel
    if kernel.camera.shape != photo.shape:
        if not same_proportions(kernel.camera.shape, photo.shape):
            raise _misfit("kernel", kernel.camera, photo, file)
        kernel = kernel.at_size(*photo.shape)
    if _sweep(kernel) > _WIDEST_BLUR * max(photo.shape):
        raise KernelFileError(
            "its kernel is wider than half of the frame",
            hint="no photo can be restored from such a blur: estimate the kernel again",
            file=file,
        )
    return kernel


def fitting_camera(content: CameraFile, photo: Photo) -> CameraFile:
    """Return a camera file's content for a photo, which may have another size.

    Raises
    ------
    KernelFileError
        If the photo has other proportions.

    """
    camera = content.camera
    if camera.shape == photo.shape:
        return content
    if not same_proportions(camera.shape, photo.shape):
        raise _misfit("camera", camera, photo, None)
    return replace(content, camera=camera.scaled(*photo.shape))


def check_registration(camera: Camera, photo: Photo, file: Path | None = None) -> None:
    """Check that the camera of a registration has the size of a photo.

    Raises
    ------
    KernelFileError
        If the sizes differ. The error names the registration's file, if one is given.

    """
    if camera.shape != photo.shape:
        raise KernelFileError(
            f"the registration is for pictures of {camera.width} x {camera.height} pixels, and "
            f"{photo.source} has {photo.described_size}",
            hint="register the photos again",
            file=file,
        )


def check_region(photo: Photo, region: tuple[int, int, int, int] | None) -> None:
    """Check that a region (x, y, width, height) lies within the photo.

    Raises
    ------
    PhotoError
        If a part of it lies outside.

    """
    if region is None:
        return
    x, y, across, down = region
    height, width = photo.shape
    if x + across > width or y + down > height:
        raise PhotoError(
            f"the region {x},{y},{across},{down} reaches beyond its {photo.described_size}",
            hint="--region takes X,Y,W,H in pixels of the upright photo",
            file=photo.source,
        )


def _sweep(kernel: RotationKernel) -> float:
    """Bound the spread of the displacements over the frame, in pixels; inf: too wide for a blur.

    Displacements are nearly linear in the angles, so the corners of the box of angles bound them.
    """
    theta = kernel.theta[kernel.weights > 0]
    low, high = theta.min(0), theta.max(0)
    if np.abs(high - low).max() > _WIDEST_TURN:
        return math.inf
    ends = np.array([low - high, high - low]) / 2
    box = np.array(np.meshgrid(*ends.T, indexing="ij")).reshape(3, -1).T
    moved = displacements(homographies(kernel.camera, box), kernel.camera.corners)
    return float(np.ptp(moved, axis=1).max())


def same_proportions(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Return whether one picture may be the other one resized, with its sides rounded."""
    least = max((b - 1) / a for a, b in zip(one, other, strict=True))
    most = min((b + 1) / a for a, b in zip(one, other, strict=True))
    return least < most


def _misfit(what: str, camera: Camera, photo: Photo, file: Path | None) -> KernelFileError:
    made_for = f"the {what} is for pictures of {camera.width} x {camera.height} pixels"
    turned = same_proportions(camera.shape[::-1], photo.shape)
    why = "photos count upright" if photo.stored_turned else "the photo has been turned since"
    return KernelFileError(
        f"{made_for}, and {photo.source} has {photo.described_size}",
        hint=f"{why}: make the {what} from the photo as it is now"
        if turned
        else "the photo must not be cropped",
        file=file,
    )
