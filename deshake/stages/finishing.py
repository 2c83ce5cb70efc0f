"""Options of a result beside the deblurring: a preview, a part of the result, a sheet.

Every command that makes a result calls the methods `prepare`, `before` and `blend` of
`FinishingOptions`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from deshake.files.disk import check_output
from deshake.geometry.distortion import pinhole
from deshake.lens.lens_warp import LensWarp
from deshake.lens.straightening import straightened
from deshake.pictures.comparison import comparison_name
from deshake.stages.blending import Mask, blended, fit_mask, mask_bytes, read_mask
from deshake.stages.preview import preview_photo
from deshake.stages.result_file import AS_THE_PHOTO, ResultFile

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from deshake.formats.photo import Photo
    from deshake.geometry.camera import Camera

__all__ = ["AS_IT_IS", "FinishingOptions"]


@dataclass(frozen=True)
class FinishingOptions:
    """Options of a result beside the deblurring.

    Parameters
    ----------
    strength : float
        Share of the result in the mix, 0..1; the rest is the photo.
    mask : Path, optional
        A grey picture, white where the photo is kept (`read_mask`).
    preview : bool
        Whether to do everything at a quarter of the size (`preview_photo`).
    protect_moving : bool
        Whether parts whose blur is not that of the camera keep the photo.
    moving_mask : Path, optional
        File for the mask of these parts, as `read_mask` takes it.
    compare : bool
        Whether to draw a sheet that compares before and after.
    keep_geometry : bool
        Whether the result keeps the lens distortion of the photo, if the kernel's camera has any.
    linear : bool
        Whether to write the result of a RAW file in linear light.
    with_provenance : bool
        Whether to write the provenance into the metadata of the result.
    file : ResultFile
        Options of the file of the result.

    Raises
    ------
    ValueError
        If the strength is not from 0 to 1, or there is a file for a mask that is not computed.

    """

    strength: float = 1.0
    mask: Path | None = None
    preview: bool = False
    protect_moving: bool = False
    moving_mask: Path | None = None
    compare: bool = False
    keep_geometry: bool = False
    linear: bool = False
    with_provenance: bool = True
    file: ResultFile = AS_THE_PHOTO

    def __post_init__(self) -> None:
        """Check the strength, and that the mask is computed if it is written."""
        if not 0 <= self.strength <= 1:
            raise ValueError(f"a strength of {self.strength} is not from 0 to 1")
        if self.moving_mask is not None and not self.protect_moving:
            raise ValueError("the mask of moving parts is computed only if they are protected")

    def sheet(self, output: Path) -> Path | None:
        """Return the path of the sheet that compares before and after; None: there is no sheet."""
        return output.with_name(comparison_name(output)) if self.compare else None

    def check(self, output: Path, *inputs: Path, overwrite: bool) -> None:
        """Check that no output is the mask, and that sheet and written mask may be written.

        Parameters
        ----------
        output : Path
            The result.
        *inputs : Path
            Files that must not be overwritten.
        overwrite : bool
            Whether an existing sheet or mask may be replaced.

        Raises
        ------
        OutputError
            If an output is the mask or an input, or the sheet or the written mask exists already.

        """
        if self.mask is not None:
            check_output(output, self.mask, overwrite=True)
            inputs = *inputs, self.mask
        for other in (self.sheet(output), self.moving_mask):
            if other is not None:
                check_output(other, output, *inputs, overwrite=overwrite)

    def prepare(self, photo: Photo) -> tuple[Photo, Mask | None]:
        """Return a photo, reduced for a preview, and its mask at the same size, if there is one.

        Raises
        ------
        PhotoError
            For the reasons of `read_mask`.

        """
        mask = None if self.mask is None else read_mask(self.mask, photo)
        if not self.preview:
            return photo, mask
        small = preview_photo(photo)
        return small, mask and replace(mask, share=fit_mask(mask.share, small.shape))

    def before(self, photo: Photo, mask: Mask | None, camera: Camera) -> tuple[Photo, Mask | None]:
        """Return a photo and its mask in the geometry of the result, straightened if it is."""
        compared = self.strength != 1 or mask is not None or self.compare
        if self.keep_geometry or camera.is_pinhole or not compared:
            return photo, mask
        straight, pinhole = straightened(photo, camera)
        if mask is None:
            return straight, None
        return straight, replace(mask, share=LensWarp(camera, pinhole).straighten(mask.share))

    def blend(self, photo: Photo, result: Photo, mask: Mask | None) -> Photo:
        """Mix a result with its photo; photo and mask come from `before`."""
        share = None if mask is None else mask.share
        return blended(photo, result, strength=self.strength, mask=share)

    def mask_of(self, share: NDArray[np.float32], camera: Camera) -> bytes:
        """Return the file of a mask, in the geometry of the photo.

        Parameters
        ----------
        share : (H, W) array of float32
            Share of the photo that is kept, in the geometry of the result.
        camera : Camera
            The kernel's camera.

        """
        if not (camera.is_pinhole or self.keep_geometry):
            share = LensWarp(camera, pinhole(camera)).bend(share)
        return mask_bytes(share)

    def provenance(self, mask_sha256: str | None = None) -> dict[str, Any]:
        """Return the options that differ from the default, for the provenance of the result.

        Parameters
        ----------
        mask_sha256 : str, optional
            SHA-256 of the mask's file, if there is one.

        """
        options: dict[str, Any] = {}
        if self.strength != 1:
            options["strength"] = self.strength
        if mask_sha256 is not None:
            options["mask_sha256"] = mask_sha256
        if self.preview:
            options["preview"] = True
        if self.protect_moving:
            options["protect_moving"] = True
        if self.keep_geometry:
            options["keep_geometry"] = True
        if self.linear:
            options["linear"] = True
        return options | self.file.provenance()

    def report(self) -> dict[str, Any]:
        """Return what the report says beside the figures, as JSON data."""
        return {"preview": True} if self.preview else {}


AS_IT_IS: Final = FinishingOptions()
"""The defaults: only the whole result."""
