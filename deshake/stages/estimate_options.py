"""What an estimate of a kernel uses, beside the photo."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from deshake.blind.bounds import blur_bound
from deshake.stages.camera_choice import CameraChoice

if TYPE_CHECKING:
    from deshake.blind.estimate import Estimator
    from deshake.formats.transfer import TransferName
    from deshake.geometry.camera import Camera

__all__ = ["EstimateOptions", "largest_blur"]


@dataclass(frozen=True)
class EstimateOptions:
    """What an estimate uses, beside the photo.

    Parameters
    ----------
    camera : CameraChoice
        The camera that is named, if one is.
    transfer : {"srgb", "linear", "gamma22"}, optional
        The file's transfer curve.
    blur_size : float, optional
        Largest blur to look for, in pixels of the photo.
    max_angle : float, optional
        Largest turn about any axis to look for, in degrees; counts if there is no `blur_size`.
    region : (x, y, width, height), optional
        The part of the photo that a blind estimate uses.
    uniform : bool
        Whether the blur is taken to be the same all over the frame.
    estimator : {"edges", "variational"}
        How a blind estimate works.
    search_angle : float, optional
        Largest rotation about any axis between a blurred and a noisy photo, in degrees; by default
        10.
    preview : bool
        Whether the photo was reduced first (`preview_photo`); the kernel's provenance has it.

    """

    camera: CameraChoice = field(default_factory=CameraChoice)
    transfer: TransferName | None = None
    blur_size: float | None = None
    max_angle: float | None = None
    region: tuple[int, int, int, int] | None = None
    uniform: bool = False
    estimator: Estimator = "edges"
    search_angle: float | None = None
    preview: bool = False

    def provenance(self, *, pair: bool = False) -> dict[str, Any]:
        """Return what shapes the kernel, for its file; the camera stands beside it.

        Parameters
        ----------
        pair : bool, keyword-only
            Whether the estimate is from a blurred and a noisy photo, which has no region and no
            estimator to choose.

        """
        blind = () if pair else ("region",)
        names = "transfer", "blur_size", "max_angle", *blind, "uniform"
        told = {name: getattr(self, name) for name in names}
        if not pair:
            told["estimator"] = self.estimator
        elif self.search_angle is not None:
            told["search_angle"] = self.search_angle
        if self.preview:
            told["preview"] = True
        return told | self.camera.provenance()


def largest_blur(camera: Camera, options: EstimateOptions) -> float | None:
    """Return the bound of the blur in pixels of the photo; None: it is to be found."""
    if options.blur_size is None and options.max_angle is not None:
        return blur_bound(camera, math.radians(options.max_angle))
    return options.blur_size
