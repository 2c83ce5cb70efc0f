"""Profiles of lenses and crop factors of cameras, from lensfun's database.

lensfunpy [1]_ is an extra (``deshake[lens]``): the library is under the LGPL 3, its data are under
CC BY-SA 3.0. Nothing of either is part of deshake. Names must match exactly, except for case,
blanks and the maker's name before the lens's. lensfun's own search takes the nearest name, which
may be another lens.

References
----------
.. [1] https://lensfun.github.io and https://github.com/letmaik/lensfunpy

"""

from __future__ import annotations

import importlib
import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from deshake.errors import CalibrationError
from deshake.geometry.distortion import fit_distortion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.metadata.camera_tags import CameraTags

__all__ = ["LensProfile", "crop_factor", "find_profile"]

_BOARD: Final = "or find it with calibrate --chessboard"
_WITH_MORE: Final = re.compile(r"compatibles[^,+]*[,+]")  # converters, macro, other raw formats
_SMALLER: Final = (
    0.96  # least crop factor of the camera, as a share of the profile's; lensfun's value
)
_SAMPLES: Final = 60  # points of the profile's curve
_BEYOND: Final = 1.02  # half diagonals: how far out the curve is sampled
_FAR: Final = 1000.0  # m: the distance of the scene


@dataclass(frozen=True, eq=False)
class LensProfile:
    """The distortion of a lens at the focal length of a photo.

    Parameters
    ----------
    lens : str
        Its name in lensfun's database.
    focal_mm : float
        The focal length that the profile was taken at, in millimetres.
    distortion : (8,) array of float64
        Its distortion in OpenCV's order.
    error_px : float
        Largest distance from the profile's curve, in pixels of the whole frame.

    """

    lens: str
    focal_mm: float
    distortion: NDArray[np.float64]
    error_px: float


def crop_factor(make: str, model: str) -> float | None:
    """Return a camera's crop factor; None: it is not known, or lensfunpy is not installed."""
    try:
        cameras = _cameras(make, model)
    except CalibrationError:
        return None
    factors = {float(camera.crop_factor) for camera in cameras}
    return round(factors.pop(), 4) if len(factors) == 1 else None


def find_profile(
    tags: CameraTags,
    focal_px: float,
    frame: tuple[float, float],
    *,
    lens: str | None = None,
) -> LensProfile:
    """Return the profile of the lens that took a photo.

    Parameters
    ----------
    tags : CameraTags
        The camera's tags.
    focal_px : float
        The focal length in pixels of the photo.
    frame : (float, float)
        Longer and shorter side of the whole frame in pixels of the photo.
    lens : str, optional, keyword-only
        The lens's name in lensfun; by default EXIF names the lens.

    Raises
    ------
    CalibrationError
        If lensfunpy is not installed, camera or lens are not in its database, or the profile
        cannot be used: for a fisheye, a smaller sensor, another range of focal lengths.

    """
    cameras = _cameras(tags.make, tags.model)
    named = f"{tags.make} {tags.model}".strip() or "a camera without a name"
    if lens is not None:
        lenses = [item for item in _database().lenses if _key(item.model) == _key(lens)]
        missing = f"lensfun has no lens {lens!r}"
    elif not cameras:
        raise CalibrationError(
            f"lensfun has no camera {named}", hint=f"name the lens with --lens-model NAME, {_BOARD}"
        )
    else:
        lenses = _lenses_by_exif(cameras, tags)
        missing = f"lensfun has no profile of {tags.lens_model or 'the lens'} on {named}"
    if not lenses:
        raise CalibrationError(missing, hint=_similar(lens or tags.lens_model))
    focal_mm = tags.focal_mm or _fixed(lenses)
    if focal_mm is None:
        raise CalibrationError(
            "no focal length in its metadata, which the distortion of the lens depends on",
            hint=f"use a photo with its metadata, {_BOARD}",
        )
    crop = math.hypot(36, 24) / math.hypot(*frame) * focal_px / focal_mm
    return _profile(_suitable(lenses, crop, focal_mm), focal_mm, focal_px, crop, frame)


def _profile(
    lens: Any,  # noqa: ANN401 - lensfunpy has no types
    focal_mm: float,
    focal_px: float,
    crop: float,
    frame: tuple[float, float],
) -> LensProfile:
    """Fit OpenCV's model to a profile's curve."""
    lensfun = _lensfun()
    width, height = (round(side) for side in frame)
    modifier = lensfun.Modifier(lens, crop, width, height)
    flags = lensfun.ModifyFlags.DISTORTION
    modifier.initialize(focal_mm, lens.min_aperture or 8.0, _FAR, scale=1.0, flags=flags)
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    shares = np.linspace(0, _BEYOND, _SAMPLES + 1)[1:]
    straight = shares * np.hypot(*middle)
    bent_points = np.array(
        [
            modifier.apply_geometry_distortion(*map(float, middle * (1 + share)), 1, 1)[0, 0]
            for share in shares
        ]
    )
    bent = np.hypot(*(bent_points - middle).T)
    try:
        distortion, error = fit_distortion(straight / focal_px, bent / focal_px)
    except ValueError as cause:
        raise CalibrationError(
            f"lensfun's profile of {lens.model} at {focal_mm:g} mm cannot be used: {cause}",
            hint="find the distortion with calibrate --chessboard",
        ) from cause
    return LensProfile(str(lens.model), focal_mm, distortion, error * focal_px)


def _lenses_by_exif(cameras: list[Any], tags: CameraTags) -> list[Any]:
    """Return the lenses that EXIF names and the camera's mount fits, or its built-in lens."""
    mounts = {camera.mount for camera in cameras}
    if all(mount[:1].islower() for mount in mounts):  # a mount of one camera: the lens is built in
        built_in = [lens for lens in _database().lenses if mounts & set(lens.mounts)]
        return [lens for lens in built_in if not _WITH_MORE.search(lens.model)]
    for mount in tuple(mounts):
        entry = _database().find_mount(mount)
        mounts |= set() if entry is None else set(entry.compat)
    wanted = {_key(tags.lens_model), _key(f"{tags.lens_make} {tags.lens_model}")} - {""}
    return [
        lens
        for lens in _database().lenses
        if mounts & set(lens.mounts)
        and wanted & {_key(lens.model), _key(lens.model, lens.maker), _key(lens.model, tags.make)}
    ]


def _suitable(lenses: list[Any], crop: float, focal_mm: float) -> Any:  # noqa: ANN401
    """Return the profile of a lens that was measured on the sensor nearest to the camera's."""
    lens = lenses[0].model
    lenses = [item for item in lenses if "FISHEYE" not in str(item.type)]
    if not lenses:
        raise CalibrationError(
            f"{lens} is a fisheye", hint="fisheye photos cannot be straightened: leave --lens out"
        )
    lenses = [item for item in lenses if item.calib_distortion]
    if not lenses:
        raise CalibrationError(
            f"lensfun's profile of {lens} has no distortion",
            hint=f"try without --lens, {_BOARD}",
        )
    low, high = min(item.min_focal for item in lenses), max(item.max_focal for item in lenses)
    lenses = [item for item in lenses if 0.95 * item.min_focal <= focal_mm <= 1.05 * item.max_focal]
    if not lenses:
        raise CalibrationError(
            f"the photo was taken at {focal_mm:g} mm, and {lens} has {low:g} to {high:g} mm",
            hint="name the lens with --lens-model NAME",
        )
    lenses = [item for item in lenses if item.crop_factor * _SMALLER <= crop]
    if not lenses:
        raise CalibrationError(
            f"lensfun knows {lens} on smaller sensors only", hint=f"try without --lens, {_BOARD}"
        )
    return max(lenses, key=lambda item: item.crop_factor)


def _fixed(lenses: list[Any]) -> float | None:
    """Return the focal length of lenses that have only one."""
    lengths = {float(end) for lens in lenses for end in (lens.min_focal, lens.max_focal)}
    return lengths.pop() if len(lengths) == 1 else None


def _similar(name: str) -> str:
    """Return a hint, with similar names of lenses if there are any."""
    numbers = set(re.findall(r"\d[\d.]*", name))
    similar = {
        lens.model
        for lens in _database().lenses
        if len(numbers) > 1 and numbers <= set(re.findall(r"\d[\d.]*", lens.model))
    }
    if not similar:
        return f"name the lens with --lens-model NAME, {_BOARD}"
    return f"name the lens with --lens-model: {', '.join(sorted(similar)[:4])}"


def _key(name: str, maker: str | None = None) -> str:
    """Reduce a name to the part that distinguishes lenses."""
    key = re.sub(r"\s+|f/", lambda match: "f" if "/" in match[0] else "", name.casefold())
    if maker is not None:
        brand = maker.casefold().split()
        key = key.removeprefix(brand[0]) if brand else key
    return key


def _cameras(make: str, model: str) -> list[Any]:
    """Return the cameras of a name."""
    wanted = (make.casefold(), model.casefold())
    return [
        camera
        for camera in _database().cameras
        if (camera.maker.casefold(), camera.model.casefold()) == wanted
    ]


@cache
def _database() -> Any:  # noqa: ANN401
    return _lensfun().Database()


def _lensfun() -> Any:  # noqa: ANN401
    try:
        return importlib.import_module("lensfunpy")
    except ImportError as error:
        raise CalibrationError(
            "lens profiles need lensfunpy", hint="pip install 'deshake[lens]'"
        ) from error
