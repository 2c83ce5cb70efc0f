"""What is wanted of a result beside the deblurring: a preview of it, a part of it, a sheet.

Every way from a photo to its result goes through `Finish.prepare`, `Finish.before` and
`Finish.blend`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from deshake.files.disk import check_output
from deshake.lens.lens_warp import LensWarp
from deshake.lens.straightening import straightened
from deshake.pictures.comparison import comparison_name
from deshake.stages.blending import Mask, blended, fit_mask, read_mask
from deshake.stages.preview import preview_photo

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.formats.photo import Photo
    from deshake.geometry.camera import Camera

__all__ = ["AS_IT_IS", "Finish"]


@dataclass(frozen=True)
class Finish:
    """What is wanted of a result beside the deblurring.

    Parameters
    ----------
    strength : float
        The share of the result that is taken, 0..1; the rest is the photo.
    mask : Path, optional
        A grey picture, white where the photo is kept (`read_mask`).
    preview : bool
        Whether all is done at a quarter of the size (`preview_photo`).
    compare : bool
        Whether a sheet that compares before and after is drawn, beside the result.
    keep_geometry : bool
        Whether the result is bent as the photo is, where the kernel's camera has a lens that bends.
    linear : bool
        Whether the result of a RAW file is written in linear light.
    with_provenance : bool
        Whether the result tells in its metadata how it came about.

    Raises
    ------
    ValueError
        If the strength is no share.

    """

    strength: float = 1.0
    mask: Path | None = None
    preview: bool = False
    compare: bool = False
    keep_geometry: bool = False
    linear: bool = False
    with_provenance: bool = True

    def __post_init__(self) -> None:
        """Check the strength."""
        if not 0 <= self.strength <= 1:
            raise ValueError(f"a strength of {self.strength} is not from 0 to 1")

    def sheet(self, output: Path) -> Path | None:
        """Return where the sheet goes that compares before and after; None: there is none."""
        return output.with_name(comparison_name(output)) if self.compare else None

    def check(self, output: Path, *inputs: Path, overwrite: bool) -> None:
        """Check that the outputs of a result are not its mask, and that the sheet may be written.

        Parameters
        ----------
        output : Path
            The result.
        *inputs : Path
            Files that are not to be written to.
        overwrite : bool
            Whether an existing sheet may be replaced.

        Raises
        ------
        OutputError
            If it may not.

        """
        if self.mask is not None:
            check_output(output, self.mask, overwrite=True)
            inputs = *inputs, self.mask
        sheet = self.sheet(output)
        if sheet is not None:
            check_output(sheet, output, *inputs, overwrite=overwrite)

    def prepare(self, photo: Photo) -> tuple[Photo, Mask | None]:
        """Return a photo, reduced for a preview, and the mask that fits it, if there is one.

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
        """Return a photo and its mask as the result is compared with them: straight, if it is."""
        compared = self.strength != 1 or mask is not None or self.compare
        if self.keep_geometry or camera.is_pinhole or not compared:
            return photo, mask
        straight, seen = straightened(photo, camera)
        if mask is None:
            return straight, None
        return straight, replace(mask, share=LensWarp(camera, seen).straighten(mask.share))

    def blend(self, photo: Photo, result: Photo, mask: Mask | None) -> Photo:
        """Return what is taken of a result, the photo and its mask being those of `before`."""
        share = None if mask is None else mask.share
        return blended(photo, result, strength=self.strength, mask=share)

    def provenance(self, mask_sha256: str | None = None) -> dict[str, Any]:
        """Return what shapes the result, for its provenance: what is not by default.

        Parameters
        ----------
        mask_sha256 : str, optional
            The SHA-256 of the mask's file, if there is one.

        """
        told: dict[str, Any] = {}
        if self.strength != 1:
            told["strength"] = self.strength
        if mask_sha256 is not None:
            told["mask_sha256"] = mask_sha256
        if self.preview:
            told["preview"] = True
        if self.keep_geometry:
            told["keep_geometry"] = True
        if self.linear:
            told["linear"] = True
        return told

    def report(self) -> dict[str, Any]:
        """Return what to know of a result beside its figures, as JSON data."""
        return {"preview": True} if self.preview else {}


AS_IT_IS: Final = Finish()
"""The result itself, whole and alone."""
