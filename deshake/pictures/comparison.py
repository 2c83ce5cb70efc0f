"""A photo before and after, side by side: the whole frames, a part at 100 %, and the kernel."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

from deshake.pictures.render import render_kernel
from deshake.pictures.sheets import Row, detailed_part, resized, sheet, shown

if TYPE_CHECKING:
    from pathlib import Path

    from deshake.formats.photo import Photo
    from deshake.geometry.kernel import RotationKernel
    from deshake.pictures.canvas import Picture

__all__ = ["SUFFIX", "before_and_after", "comparison_name", "comparison_sheet"]

SUFFIX: Final = ".compare"
"""The part of a sheet's name before the ending."""

_WIDTH: Final = 640  # px of each picture


def comparison_name(output: Path) -> str:
    """Return the name of the sheet that goes with a result: ``<stem>.compare.png``."""
    return f"{output.stem}{SUFFIX}.png"


def before_and_after(
    photo: Photo, result: Photo, kernel: RotationKernel, width: int
) -> list[Picture]:
    """Draw a photo and its result.

    Parameters
    ----------
    photo, result : Photo
        Before and after.
    kernel : RotationKernel
        The kernel of the deblurring.
    width : int
        Width of each picture, in pixels.

    Returns
    -------
    five (h, w, 3) arrays of uint8
        Before, after, the kernel's rotations; then the part with the most detail at 100 %, before
        and after: these may be narrower. The part is chosen in the photo, since ringing in the
        result looks like detail.

    """
    before, after = shown(photo), shown(result)
    small = resized(before, width)
    part = detailed_part(before, width, max(small.shape[0], width // 2))
    drawn = render_kernel(kernel, size=width)
    return [small, resized(after, width), drawn, before[part], after[part]]


def comparison_sheet(photo: Photo, result: Photo, kernel: RotationKernel) -> bytes:
    """Draw a photo before and after on one sheet, as a PNG."""
    before, after, drawn, part, restored = before_and_after(photo, result, kernel, _WIDTH)
    height, width = photo.shape
    text = f"{photo.source.name}   {width} x {height}   kernel: {kernel.extent_px():.1f} px"
    lines = [
        Row([text], [before, after], titles=("before", "after")),
        Row([], [part, restored, drawn], titles=("before, 100 %", "after, 100 %", "kernel")),
    ]
    encoded = io.BytesIO()
    sheet(lines).save(encoded, "PNG")
    return encoded.getvalue()
