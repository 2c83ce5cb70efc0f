"""What a blind estimate goes by, beside the photo."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from deshake.blind.bounds import blur_bound

if TYPE_CHECKING:
    from deshake.blind.estimate import Estimator
    from deshake.files.kernel_file import CameraFile
    from deshake.formats.transfer import TransferName
    from deshake.geometry.camera import Camera

__all__ = ["EstimateOptions", "largest_blur"]


@dataclass(frozen=True)
class EstimateOptions:
    """What a blind estimate goes by, beside the photo.

    Parameters
    ----------
    focal_px, focal_35mm : float, optional
        Focal length in pixels of the photo, or in millimetres on 35 mm film; by default from EXIF.
    camera : CameraFile, optional
        The camera, instead of both; with its lens, if it has one.
    focal : {"auto"}, optional
        The focal length is found with the kernel, instead of all these.
    lens : bool
        Whether the distortion of the lens is looked up in lensfun's database.
    lens_model : str, optional
        The lens's name in it; by default by EXIF.
    transfer : {"srgb", "linear", "gamma22"}, optional
        The file's transfer curve.
    blur_size : float, optional
        Largest blur to look for, in pixels of the photo.
    max_angle : float, optional
        Largest turn about any axis to look for, in degrees; counts if there is no `blur_size`.
    region : (x, y, width, height), optional
        The part of the photo to go by.
    uniform : bool
        Whether the blur is taken to be the same all over the frame.
    estimator : {"edges", "variational"}
        How the kernel is estimated.
    preview : bool
        Whether the photo was reduced first (`preview_photo`); told in the kernel's provenance.

    """

    focal_px: float | None = None
    focal_35mm: float | None = None
    camera: CameraFile | None = None
    focal: Literal["auto"] | None = None
    lens: bool | None = None
    lens_model: str | None = None
    transfer: TransferName | None = None
    blur_size: float | None = None
    max_angle: float | None = None
    region: tuple[int, int, int, int] | None = None
    uniform: bool = False
    estimator: Estimator = "edges"
    preview: bool = False

    @property
    def undoes_lens(self) -> bool:
        """Whether a lens that bends is undone, as far as the options tell."""
        if self.camera is not None:
            return not self.camera.camera.is_pinhole
        return bool(self.lens) or self.lens_model is not None

    def provenance(self) -> dict[str, Any]:
        """Return what shapes the kernel, for its file; the camera is told apart."""
        names = ("transfer", "blur_size", "max_angle", "region", "uniform", "estimator")
        told = {name: getattr(self, name) for name in names}
        if self.preview:
            told["preview"] = True
        if self.focal is not None:
            told["focal"] = self.focal
        if self.lens or self.lens_model is not None:
            told["lens"] = self.lens_model or True
        return told


def largest_blur(camera: Camera, options: EstimateOptions) -> float | None:
    """Return the bound of the blur in pixels of the photo; None: it is to be found."""
    if options.blur_size is None and options.max_angle is not None:
        return blur_bound(camera, math.radians(options.max_angle))
    return options.blur_size
