"""The preview: a photo at a quarter of its size, on which all stages take seconds.

A kernel consists of angles. So a kernel from one size of a photo is valid for every size. The time
of a blind estimate depends on the size of its picture only if that is small. A preview uses such a
small picture, and keeps the first good kernel.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from deshake.run import Run
from deshake.stages.blind_estimate import silent_estimate, warn
from deshake.stages.fitting import check_region
from deshake.stages.reducing import reduced, reduced_with_metadata

if TYPE_CHECKING:
    from deshake.formats.photo import Photo
    from deshake.stages.estimate_options import EstimateOptions
    from deshake.stages.estimate_result import Estimate

__all__ = ["preview_estimate", "preview_options", "preview_photo", "preview_side"]

_FACTOR: Final = 4  # ratio of the photo's sides to the preview's
_LEAST_SIDE: Final = 640  # px of the longer side
_INVISIBLE: Final = (
    "no shake is visible at the size of a preview: the photo is left as it is; to be sure, leave "
    "out --preview"
)
_ESTIMATE_SIDE: Final = 400  # px of the longer side of the picture for the estimate


def preview_photo(photo: Photo) -> Photo:
    """Reduce a photo to a quarter of its width and height, its longer side to no less than 640 px.

    Each new pixel is a mean in linear light. It counts as clipped if one of its pixels is clipped.
    Format and depth do not change. The metadata state what is true for the reduced photo.
    """
    return reduced_with_metadata(photo, preview_side(max(photo.shape)))


def preview_side(side: float) -> float:
    """Return the longer side of a photo's preview in pixels; a small photo may have less."""
    return max(side / _FACTOR, _LEAST_SIDE)


def preview_estimate(
    photo: Photo,
    small: Photo,
    options: EstimateOptions,
    *,
    run: Run = Run(),
) -> Estimate:
    """Estimate the blur kernel of a reduced photo.

    The picture for the estimate is smaller still. If no shake is visible there, the preview itself
    is used. A narrow shake of a large photo may be visible in neither. Then a note says so.

    Parameters
    ----------
    photo, small : Photo
        The photo, and its preview from `preview_photo`.
    options : EstimateOptions
        Options of the estimate, in pixels of the photo.
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    Estimate
        The estimate; its kernel and its camera belong to the reduced photo.

    Raises
    ------
    DeshakeError
        For the reasons of `estimate_blind`.

    """
    smaller = reduced(small, _ESTIMATE_SIDE)
    sizes = [smaller] if smaller is small else [smaller, small]
    for size, part in zip(sizes, run.parts([1.0, 2.0][: len(sizes)]), strict=True):
        estimate = silent_estimate(size, preview_options(options, photo, size), run=part)
        if len(estimate.kernel.weights) > 1:
            break
    else:
        if small is not photo:
            estimate = replace(estimate, notes=[_INVISIBLE])
    warn(photo, estimate)
    kernel = estimate.content.kernel.at_size(*small.shape)
    camera = replace(estimate.camera, camera=estimate.camera.camera.scaled(*small.shape))
    return replace(estimate, content=replace(estimate.content, kernel=kernel), camera=camera)


def preview_options(options: EstimateOptions, photo: Photo, small: Photo) -> EstimateOptions:
    """Return the options for the reduced photo: all lengths in pixels are scaled.

    Raises
    ------
    PhotoError
        If the region lies outside the photo.

    """
    check_region(photo, options.region)
    (height, width), (high, wide) = photo.shape, small.shape
    scale = wide / width
    region = options.region
    if region is not None:
        x, y, across, down = region
        left, top = x * wide // width, y * high // height
        right = math.ceil((x + across) * wide / width)
        bottom = math.ceil((y + down) * high / height)
        region = left, top, right - left, bottom - top
    focal_px = options.camera.focal_px
    return replace(
        options,
        camera=replace(options.camera, focal_px=None if focal_px is None else focal_px * scale),
        blur_size=None if options.blur_size is None else max(options.blur_size * scale, 1.0),
        region=region,
        preview=True,
    )
