"""ICC profiles for pictures without one: sRGB, linear light, a power, and code points.

This module writes their bytes itself, since libraries put the time of day into a profile.

References
----------
.. [1] ICC.1:2022, Image technology colour management, Secs. 7.2, 8.3, 9.2 and 10.
.. [2] IEC 61966-2-1:1999, the sRGB colour space.
.. [3] Recommendation ITU-T H.273, Secs. 8.1 and 8.2.

"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

import numpy as np

from deshake.errors import PhotoError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "GREY_PROFILE",
    "SRGB_PROFILE",
    "XYZ_FROM_SRGB",
    "cicp_profile",
    "linear_profile",
    "power_profile",
]

XYZ_FROM_SRGB: Final = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
"""CIE XYZ, with white D65, from linear sRGB [2]_."""

_WHITE: Final = (0.9642, 1.0, 0.8249)  # D50, the white of all profiles
_ADAPTATION: Final = np.array(  # from D65 to D50, by Bradford's method
    [
        [1.0478112, 0.0228866, -0.0501270],
        [0.0295424, 0.9904844, -0.0170491],
        [-0.0092345, 0.0150436, 0.7521316],
    ]
)
_LINEAR: Final = b"curv" + bytes(8)
_HDR: Final = {16: "PQ", 18: "HLG"}
_PRIMARIES: Final = {  # x and y of red, green and blue, of white D65
    1: (0.64, 0.33, 0.30, 0.60, 0.15, 0.06),  # sRGB
    9: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046),  # BT.2020
    12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060),  # Display P3
}
_SRGB_CURVE: Final = struct.pack(
    ">4s4xH2x5i",
    b"para",
    3,
    *(round(x * 65536) for x in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)),
)
_CURVES: Final = {
    4: struct.pack(">4s4xH2xi", b"para", 0, round(2.2 * 65536)),
    5: struct.pack(">4s4xH2xi", b"para", 0, round(2.8 * 65536)),
    8: _LINEAR,
}


def linear_profile(to_srgb: ArrayLike | None = None, *, grey: bool = False) -> bytes:
    """Make the profile of linear light.

    Parameters
    ----------
    to_srgb : (3, 3) array, optional
        The matrix from the picture's colours to linear sRGB; by default they are sRGB's.
    grey : bool, keyword-only
        Whether the picture is grey.

    """
    if grey:
        return _profile("Linear grey", {b"kTRC": _LINEAR}, grey=True)
    name = "Linear sRGB" if to_srgb is None else "Linear light of the camera"
    return _rgb_profile(name, np.eye(3) if to_srgb is None else np.asarray(to_srgb), _LINEAR)


def power_profile(gamma: float, *, grey: bool = False) -> bytes:
    """Make the profile of a pure power, with sRGB's primaries.

    Parameters
    ----------
    gamma : float
        Light = code ** gamma.
    grey : bool, keyword-only
        Whether the picture is grey.

    """
    curve = struct.pack(">4s4xH2xi", b"para", 0, round(gamma * 65536))
    name = f"Gamma {gamma:.6g}"
    if grey:
        return _profile(name, {b"kTRC": curve}, grey=True)
    return _rgb_profile(name, np.eye(3), curve)


def cicp_profile(primaries: int, transfer: int) -> bytes:
    """Make the profile of coding-independent code points [3]_; empty if they are sRGB's.

    The curves of television count as sRGB's: photos that state them have sRGB's curve.

    Parameters
    ----------
    primaries, transfer : int
        Colour primaries and transfer characteristics.

    Raises
    ------
    PhotoError
        If the curve is one of HDR, PQ or HLG.

    """
    if transfer in _HDR:
        raise PhotoError(
            f"an HDR picture ({_HDR[transfer]})", hint="convert it to 16 bits without HDR first"
        )
    curve = _CURVES.get(transfer, _SRGB_CURVE)
    x, y = np.array(_PRIMARIES.get(primaries, _PRIMARIES[1])).reshape(3, 2).T
    if primaries not in _PRIMARIES or primaries == 1:
        if curve is _SRGB_CURVE:
            return b""
        primaries = 1
    columns = np.array([x / y, np.ones(3), (1 - x - y) / y])
    columns *= np.linalg.solve(columns, XYZ_FROM_SRGB.sum(1))  # their sum is white, D65
    name = f"Primaries {primaries}, transfer {transfer}"
    return _rgb_profile(name, np.linalg.solve(XYZ_FROM_SRGB, columns), curve)


def _rgb_profile(name: str, to_srgb: NDArray[np.float64], curve: bytes) -> bytes:
    """Make a profile of three colours and one curve."""
    primaries = _ADAPTATION @ XYZ_FROM_SRGB @ to_srgb
    primaries *= (np.array(_WHITE) / primaries.sum(1))[:, None]  # exact white
    tags = {b"%cXYZ" % c: _xyz(primaries[:, i]) for i, c in enumerate(b"rgb")}
    return _profile(name, tags | {b"%cTRC" % c: curve for c in b"rgb"})


def _profile(name: str, tags: dict[bytes, bytes], *, grey: bool = False) -> bytes:
    """Put a version 4 profile together; equal elements are stored once."""
    tags = {
        b"desc": _text(name),
        b"cprt": _text("No copyright, use freely"),
        b"wtpt": _xyz(_WHITE),
        b"chad": b"sf32" + bytes(4) + _fixed(_ADAPTATION.ravel()),
    } | tags
    table, body, places = b"", b"", dict[bytes, int]()
    start = 128 + 4 + 12 * len(tags)
    for tag, content in tags.items():
        if content not in places:
            places[content] = start + len(body)
            body += content + bytes(-len(content) % 4)
        table += struct.pack(">4sII", tag, places[content], len(content))
    head = struct.pack(
        ">I4xI4s4s4s12x4s28x",
        start + len(body),
        0x04400000,
        b"mntr",
        b"GRAY" if grey else b"RGB ",
        b"XYZ ",
        b"acsp",
    )
    head += _fixed(_WHITE)
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + body


def _text(text: str) -> bytes:
    encoded = text.encode("utf-16-be")
    return struct.pack(">4s4xII4sII", b"mluc", 1, 12, b"enUS", len(encoded), 28) + encoded


def _xyz(values: ArrayLike) -> bytes:
    return b"XYZ " + bytes(4) + _fixed(values)


def _fixed(values: ArrayLike) -> bytes:
    """Write numbers as s15Fixed16."""
    return np.rint(np.asarray(values, np.float64) * 65536).astype(">i4").tobytes()


SRGB_PROFILE: Final = _rgb_profile("sRGB", np.eye(3), _SRGB_CURVE)
"""sRGB's primaries and curve."""

GREY_PROFILE: Final = _profile("sRGB grey", {b"kTRC": _SRGB_CURVE}, grey=True)
"""Grey with sRGB's curve."""
