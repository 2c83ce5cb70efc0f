"""The user's choice of a camera: a focal length, a lens, a camera file, or none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from deshake.files.kernel_file import CameraFile

__all__ = ["CameraChoice"]


@dataclass(frozen=True)
class CameraChoice:
    """The user's choice of a camera; by default the photo's metadata decide.

    Parameters
    ----------
    focal_px, focal_35mm : float, optional
        Focal length in pixels of the photo, or in millimetres on 35 mm film.
    file : CameraFile, optional
        A camera file instead of both, with its lens if it has one.
    focal : {"auto"}, optional
        Estimate the focal length together with the kernel, instead of all these, and whatever the
        metadata say.
    lens : bool
        Whether to look up the distortion of the lens in lensfun's database.
    lens_model : str, optional
        Name of the lens in that database; by default from EXIF.

    """

    focal_px: float | None = None
    focal_35mm: float | None = None
    file: CameraFile | None = None
    focal: Literal["auto"] | None = None
    lens: bool | None = None
    lens_model: str | None = None

    @property
    def has_focal_length(self) -> bool:
        """Whether a focal length is named, in a camera file or by itself."""
        named = self.file, self.focal_px, self.focal_35mm
        return any(item is not None for item in named)

    @property
    def looks_up_lens(self) -> bool:
        """Whether the lens is looked up in lensfun's database."""
        return bool(self.lens) or self.lens_model is not None

    @property
    def undoes_lens(self) -> bool:
        """Whether lens distortion is undone, as far as the choice shows."""
        return self.looks_up_lens if self.file is None else not self.file.camera.is_pinhole

    @property
    def source(self) -> str | None:
        """Source of the focal length, as in the provenance; None: the photo decides."""
        if self.file is not None:
            return self.file.source
        if self.looks_up_lens:  # the provenance has the name of the lens, too
            return None
        if self.focal_px is not None:
            return f"--focal-px {self.focal_px:g}"
        return None if self.focal_35mm is None else f"--focal-35mm {self.focal_35mm:g}"

    def provenance(self) -> dict[str, Any]:
        """Return the choices that differ from the default; the camera itself stands beside them."""
        choices: dict[str, Any] = {}
        if self.focal is not None:
            choices["focal"] = self.focal
        if self.looks_up_lens:
            choices["lens"] = self.lens_model or True
        return choices
