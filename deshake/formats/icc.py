"""The transfer curve in an ICC profile.

Only the curve is read: the ``rTRC``, ``gTRC``, ``bTRC`` or ``kTRC`` tags of types ``curv`` and
``para``. If there is no such curve, or each channel has its own, LittleCMS computes the lightness
of greys, and the nearest curve is used: sRGB's or a power. Colours are not converted; the file of
the result has the same profile.

References
----------
.. [1] ICC.1:2022, Image technology colour management, Secs. 7.2, 10.6 and 10.18.

"""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageCms

from deshake.formats.transfer import LINEAR, SRGB, Power, Table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.formats.transfer import Transfer

__all__ = ["profile_transfer"]

_HEADER = 128
_MAX_TAGS = 256  # further tags are ignored
_PARAMETERS = ("g", "gab", "gabc", "gabcd", "gabcdef")  # of the function types 0 to 4
_SAMPLES = 4096  # number, for a parametric curve that is neither sRGB nor a power
_TOLERANCE = 5e-4  # in linear light: profiles hold sRGB as a table or as rounded numbers
_ABOUT = 0.05  # in linear light: largest distance of the greys from the curve that is used
_GAMMAS = (0.3, 4.0)  # the range in which 16-bit codes survive float32


def profile_transfer(profile: bytes) -> Transfer | None:
    """Return the curve that the channels of a profile share, at least approximately; or None.

    Parameters
    ----------
    profile : bytes
        An ICC profile.

    Returns
    -------
    Transfer or None
        None if the profile is damaged or is for neither grey nor RGB, or if its curve is flat in
        places, falls, or has a wrong black or white.

    """
    try:
        tags = _read_tags(profile)
        curves = {tags[name] for name in (b"rTRC", b"gTRC", b"bTRC", b"kTRC") if name in tags}
        if len(curves) != 1:
            return _of_greys(profile)
        with np.errstate(all="ignore"):
            return _read_curve(curves.pop())
    except (struct.error, ValueError, OverflowError, ZeroDivisionError):
        return None


def _read_tags(profile: bytes) -> dict[bytes, bytes]:
    """Return the data of every tag by its signature."""
    if profile[36:40] != b"acsp":
        msg = "no ICC profile"
        raise ValueError(msg)
    (count,) = struct.unpack_from(">I", profile, _HEADER)
    tags = {}
    for index in range(min(count, _MAX_TAGS)):
        name, offset, size = struct.unpack_from(">4sII", profile, _HEADER + 4 + 12 * index)
        tags[name] = profile[offset : offset + size]
    return tags


def _read_curve(data: bytes) -> Transfer | None:
    """Read a ``curv`` or ``para`` element."""
    if data[:4] == b"curv":
        (count,) = struct.unpack_from(">I", data, 8)
        if count == 0:
            return LINEAR
        if count == 1:
            return _power(struct.unpack_from(">H", data, 12)[0] / 256)
        return _recognise(np.frombuffer(data, ">u2", count, 12) / 65535)
    (kind,) = struct.unpack_from(">H", data, 8)
    if data[:4] != b"para" or kind >= len(_PARAMETERS):
        return None
    names = _PARAMETERS[kind]
    numbers = (np.frombuffer(data, ">i4", len(names), 12) / 65536).tolist()
    if kind == 0:
        return _power(numbers[0])
    return _recognise(_parametric(dict(zip(names, numbers, strict=True))))


def _parametric(p: dict[str, float]) -> NDArray[np.float64]:
    """Sample a parametric curve (the functions 1 to 4 of Table 68 in [1]_)."""
    x = np.linspace(0, 1, _SAMPLES)
    a, b = p["a"], p["b"]
    bent = np.maximum(a * x + b, 0) ** p["g"]
    if "d" not in p:  # functions 1 and 2 change where the base of the power becomes positive
        return np.where(x >= -b / a, bent, 0) + p.get("c", 0.0)
    straight = p["c"] * x + p.get("f", 0.0)
    return np.where(x >= p["d"], bent + p.get("e", 0.0), straight)


def _of_greys(profile: bytes) -> Transfer | None:
    """Return the curve nearest to the greys of a profile, which LittleCMS converts to Lab."""
    if profile[16:20] != b"RGB ":
        return None
    ramp = np.arange(256, dtype=np.uint8)
    try:
        to_lab = ImageCms.buildTransform(
            ImageCms.ImageCmsProfile(io.BytesIO(profile)),
            ImageCms.createProfile("LAB"),
            "RGB",
            "LAB",
            renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
        )
        lab = ImageCms.applyTransform(Image.fromarray(np.stack([ramp] * 3, -1)[None]), to_lab)
    except (ImageCms.PyCMSError, OSError):
        return None
    if lab is None:
        return None
    lightness = np.asarray(lab)[0, :, 0] / 2.55
    light = np.where(lightness > 8, ((lightness + 16) / 116) ** 3, lightness * 27 / 24389)
    if light[-1] < 0.9 or light[0] > 0.02:
        return None
    light /= light[-1]
    values = ramp / 255
    middle = (values > 0.2) & (values < 0.9)
    gamma = float(np.median(np.log(light[middle]) / np.log(values[middle])))
    nearest = min(
        (curve for curve in (SRGB, _power(round(gamma, 2))) if curve is not None),
        key=lambda curve: float(np.abs(light - curve.to_linear(values)).max()),
    )
    near = np.abs(light - nearest.to_linear(values)).max() < _ABOUT
    return nearest if near else None


def _power(gamma: float) -> Transfer | None:
    return Power(gamma) if _GAMMAS[0] <= gamma <= _GAMMAS[1] else None


def _recognise(light: NDArray[np.float64]) -> Transfer | None:
    """Recognise a sampled curve as sRGB or a power; else keep the samples."""
    if not np.isfinite(light).all() or light[-1] < 0.99 or not 0 <= light[0] < 0.02:
        return None
    light = light / light[-1]
    values = np.linspace(0, 1, len(light))
    if np.abs(light - SRGB.to_linear(values)).max() < _TOLERANCE:
        return SRGB
    middle = np.interp(0.5, values, light)
    fitted = _power(round(float(np.log(middle) / np.log(0.5)), 3)) if middle > 0 else None
    if fitted is not None and np.abs(light - fitted.to_linear(values)).max() < _TOLERANCE:
        return fitted
    return Table(light)
