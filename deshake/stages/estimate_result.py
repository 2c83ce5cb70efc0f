"""An estimate: the content of a kernel file, and notes for the user."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from deshake.files.kernel_file import CameraFile, KernelFile
    from deshake.geometry.kernel import RotationKernel
    from deshake.pair.registration import Registration

__all__ = ["TRUSTED", "Estimate"]

TRUSTED: Final = 0.5
"""Confidence of a kernel from a pair below which the photo is left as it is, by default."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """The content of a kernel file, and notes for the user.

    Parameters
    ----------
    content : KernelFile
        The kernel with its confidence and provenance; from a pair, in the frame of the registered
        noisy photo.
    camera : CameraFile
        The camera that the estimate used, and where its focal length comes from.
    notes : list of str
        Notes for the user, in plain words.
    latent : (2, h, w) array of float32, optional
        Gradients of the sharp photo, or region, as in `BlindEstimate`; a pair gives none.
    noise : float, optional
        Standard deviation of the photo's noise at a mid grey (18 % of white), in linear light.
    registration : Registration, optional
        The registration of the noisy photo to the blurred one, if there is a noisy one.
    scale : float
        The photometric factor of a pair, fitted together with the kernel.
    streaks : (T, 4) array of float64, optional
        Places of the streaks of lights that the kernel was read from, as in `BlindEstimate`.

    """

    content: KernelFile
    camera: CameraFile
    notes: list[str]
    latent: NDArray[np.float32] | None = None
    noise: float | None = None
    registration: Registration | None = None
    scale: float = 1.0
    streaks: NDArray[np.float64] | None = None

    @property
    def kernel(self) -> RotationKernel:
        """The blur kernel, for the camera of the whole photo."""
        return self.content.kernel

    @property
    def confidence(self) -> float:
        """The confidence of the kernel, 0..1."""
        return self.content.confidence

    @property
    def trusted(self) -> bool:
        """Whether the confidence of a kernel from a pair is at least 0.5."""
        return self.content.confidence >= TRUSTED

    def report(self) -> dict[str, Any]:
        """Return the figures of the estimate as JSON data."""
        kernel = self.content.kernel
        report: dict[str, Any] = {
            "rotations": len(kernel.weights),
            "extent_px": round(kernel.extent_px(), 2),
            "confidence": round(self.content.confidence, 4),
        }
        if self.noise is not None:
            report["noise"] = round(self.noise, 5)
        if self.registration is not None:
            report |= {
                "trusted": self.trusted,
                "scale": round(self.scale, 5),
                "registration_confidence": round(self.registration.confidence, 4),
            }
        return report | {
            "notes": self.notes,
            "focal_px": round(self.camera.camera.focal_px, 2),
            "camera_source": self.camera.source,
        }
