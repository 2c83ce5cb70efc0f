"""The options of a kernel estimate."""

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
    """The options of a kernel estimate.

    Parameters
    ----------
    camera : CameraChoice
        The user's choice of a camera.
    transfer : {"srgb", "linear", "gamma22"}, optional
        The file's transfer curve.
    blur_size : float, optional
        Bound of the blur, in pixels of the photo.
    max_angle : float, optional
        Bound of the rotation about any axis, in degrees; ignored if there is a `blur_size`.
    region : (x, y, width, height), optional
        The part of the photo that a blind estimate uses.
    least_confidence : float, optional
        Confidence, 0..1, with which a kernel is kept, whatever the photo looks like; by default as
        `estimate_kernel` and `TRUSTED` say. An estimate by the variational inference keeps all.
    uniform : bool
        Whether to assume the same blur all over the frame.
    estimator : {"edges", "variational"}
        The estimator of a blind estimate.
    search_angle : float, optional
        Largest rotation about any axis between a blurred and a noisy photo, in degrees; by default
        10.
    preview : bool
        Whether the photo is a reduced one (`preview_photo`); the kernel's provenance says so.

    """

    camera: CameraChoice = field(default_factory=CameraChoice)
    transfer: TransferName | None = None
    blur_size: float | None = None
    max_angle: float | None = None
    region: tuple[int, int, int, int] | None = None
    least_confidence: float | None = None
    uniform: bool = False
    estimator: Estimator = "edges"
    search_angle: float | None = None
    preview: bool = False

    def provenance(self, *, pair: bool = False) -> dict[str, Any]:
        """Return the options that affect the kernel, for its file; the camera stands beside them.

        Parameters
        ----------
        pair : bool, keyword-only
            Whether the estimate is from a blurred and a noisy photo, which has no region and no
            estimator to choose.

        """
        blind = () if pair else ("region",)
        names = "transfer", "blur_size", "max_angle", *blind, "uniform"
        options = {name: getattr(self, name) for name in names}
        if not pair:
            options["estimator"] = self.estimator
        elif self.search_angle is not None:
            options["search_angle"] = self.search_angle
        if self.least_confidence is not None:
            options["least_confidence"] = self.least_confidence
        if self.preview:
            options["preview"] = True
        return options | self.camera.provenance()


def largest_blur(camera: Camera, options: EstimateOptions) -> float | None:
    """Return the bound of the blur in pixels of the photo; None: the photo decides."""
    if options.blur_size is None and options.max_angle is not None:
        return blur_bound(camera, math.radians(options.max_angle))
    return options.blur_size
