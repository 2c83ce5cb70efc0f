"""Which camera the user names for a photo: a focal length, a lens, a camera file, or none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from deshake.files.kernel_file import CameraFile

__all__ = ["CameraChoice"]


@dataclass(frozen=True)
class CameraChoice:
    """Which camera the user names for a photo; by default the photo's metadata decide.

    Parameters
    ----------
    focal_px, focal_35mm : float, optional
        Focal length in pixels of the photo, or in millimetres on 35 mm film.
    file : CameraFile, optional
        The camera, instead of both; with its lens, if it has one.
    focal : {"auto"}, optional
        The focal length is estimated with the kernel, instead of all these.
    lens : bool
        Whether the distortion of the lens is looked up in lensfun's database.
    lens_model : str, optional
        The lens's name in it; by default by EXIF.

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
        """Whether a lens that bends is undone, as far as the choice shows."""
        return self.looks_up_lens if self.file is None else not self.file.camera.is_pinhole

    @property
    def source(self) -> str | None:
        """Where the focal length will come from, as provenance has it; None: the photo decides."""
        if self.file is not None:
            return self.file.source
        if self.looks_up_lens:  # provenance has the lens's name, too
            return None
        if self.focal_px is not None:
            return f"--focal-px {self.focal_px:g}"
        return None if self.focal_35mm is None else f"--focal-35mm {self.focal_35mm:g}"

    def provenance(self) -> dict[str, Any]:
        """Return what is unusual about the choice; the camera itself stands beside it."""
        told: dict[str, Any] = {}
        if self.focal is not None:
            told["focal"] = self.focal
        if self.looks_up_lens:
            told["lens"] = self.lens_model or True
        return told
