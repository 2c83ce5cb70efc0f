"""The transfer curve in an ICC profile, where the profile has a simple one.

Only the curve is read: the ``rTRC``, ``gTRC``, ``bTRC`` or ``kTRC`` tags of types ``curv`` and
``para``. Colours are carried over as they are, with the profile.

References
----------
.. [1] ICC.1:2022, Image technology colour management, Secs. 7.2, 10.6 and 10.18.

"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

from deshake.io.transfer import LINEAR, SRGB, Power, Table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.io.transfer import Transfer

__all__ = ["profile_transfer"]

_HEADER = 128
_MAX_TAGS = 256
_PARAMETERS = ("g", "gab", "gabc", "gabcd", "gabcdef")  # of the functions 0 to 4
_SAMPLES = 4096  # of a parametric curve that is neither sRGB nor a power
_TOLERANCE = 5e-4  # in linear light: a profile's sRGB is a table or rounded numbers
_GAMMAS = (0.3, 4.0)  # the range in which 16-bit codes survive float32


def profile_transfer(profile: bytes) -> Transfer | None:
    """Return the one curve that all channels of a profile share, or None.

    Parameters
    ----------
    profile : bytes
        An ICC profile.

    Returns
    -------
    Transfer or None
        None if the profile is damaged, has no curve, has different ones by channel, or has one
        that cannot be undone exactly (flat stretches, falling, black or white far off).

    """
    try:
        tags = _read_tags(profile)
        curves = {tags[name] for name in (b"rTRC", b"gTRC", b"bTRC", b"kTRC") if name in tags}
        if len(curves) != 1:
            return None
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
    if "d" not in p:  # functions 1 and 2 break where the base of the power turns positive
        return np.where(x >= -b / a, bent, 0) + p.get("c", 0.0)
    straight = p["c"] * x + p.get("f", 0.0)
    return np.where(x >= p["d"], bent + p.get("e", 0.0), straight)


def _power(gamma: float) -> Transfer | None:
    return Power(gamma) if _GAMMAS[0] <= gamma <= _GAMMAS[1] else None


def _recognise(light: NDArray[np.float64]) -> Transfer | None:
    """Give a sampled curve its name if it has one; else keep the samples."""
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
