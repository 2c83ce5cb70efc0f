"""Options of the file of a result: its format, its quality, its size, its time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from deshake.formats.conversion import output_format
from deshake.formats.encoding import SUFFIXES
from deshake.stages.reducing import reduced_with_metadata, within_white

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.formats.encoding import Format
    from deshake.formats.photo import Photo

__all__ = ["AS_THE_PHOTO", "ResultFile"]


@dataclass(frozen=True)
class ResultFile:
    """Options of the file of a result.

    Parameters
    ----------
    form : Format, optional
        Its format; by default its name decides (`output_format`).
    jpeg_quality : int, optional
        Quality of a JPEG, 1..100; by default the tables of the photo if it is a JPEG, else 95.
    max_size : int, optional
        Pixels of the longer side: a larger result is reduced when it is written.
    keeps_time : bool
        Whether the file takes the modification time of the photo.

    Raises
    ------
    ValueError
        If the quality is not from 1 to 100, or the size is not positive.

    """

    form: Format | None = None
    jpeg_quality: int | None = None
    max_size: int | None = None
    keeps_time: bool = False

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.jpeg_quality is not None and not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"a JPEG quality of {self.jpeg_quality} is not from 1 to 100")
        if self.max_size is not None and self.max_size < 1:
            raise ValueError(f"a size of {self.max_size} pixels is not positive")

    def is_jpeg(self, output: Path) -> bool:
        """Return whether a file of this name is a JPEG, as far as the name says."""
        return (self.form or SUFFIXES.get(output.suffix.lower())) == "JPEG"

    def called(self, output: Path) -> ResultFile:
        """Return the options that apply to a file of this name: the quality is for JPEGs alone."""
        return self if self.is_jpeg(output) else replace(self, jpeg_quality=None)

    def format_of(self, output: Path, photo: Photo) -> Format:
        """Return the format of a photo's result.

        Raises
        ------
        OutputError
            For the reasons of `output_format`.

        """
        return self.form or output_format(output, photo.source, photo.encoding)

    def encoded(self, photo: Photo) -> Photo:
        """Return a photo that will be encoded with the quality."""
        return photo if self.jpeg_quality is None else photo.with_jpeg_quality(self.jpeg_quality)

    def fitted(self, photo: Photo, form: Format) -> Photo:
        """Return a photo reduced to the size, for a file of some format; it is never enlarged.

        Its metadata state what is true for the reduced picture.
        """
        if self.max_size is None or max(photo.shape) <= self.max_size:
            return photo
        keeps_beyond = photo.encoding.depth == 32 and form == "TIFF"
        light = photo if keeps_beyond else within_white(photo)
        return reduced_with_metadata(light, self.max_size)

    def provenance(self) -> dict[str, Any]:
        """Return the options that change the picture, for the provenance of the result."""
        options = {"jpeg_quality": self.jpeg_quality, "max_size": self.max_size}
        return {name: value for name, value in options.items() if value is not None}


AS_THE_PHOTO: Final = ResultFile()
"""The defaults: the file is like that of the photo."""
