"""Transfer curves: a file's code values to linear light and back.

deshake computes in linear light; a file holds codes after a transfer curve. Here a curve is a
rising map from [0, 1] onto [0, 1].

References
----------
.. [1] IEC 61966-2-1:1999, the sRGB colour space.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = [
    "LINEAR",
    "NAMED",
    "SRGB",
    "Depth",
    "Power",
    "Srgb",
    "Table",
    "Transfer",
    "TransferName",
    "clipped_pixels",
    "decode",
    "display_values",
    "encode",
    "is_clipped",
    "linear_light",
    "reduced_light",
]

Codes = NDArray[np.unsignedinteger]  # or float32, in floating-point TIFFs
Depth = Literal[8, 16, 32]
TransferName = Literal["srgb", "linear", "gamma22"]

_BAND = 128  # rows of a photo that are reduced to grey at once
_BLOCK = 1 << 20  # values that are converted at once, so that the intermediate floats stay small


class Transfer(Protocol):
    """A transfer curve.

    Attributes
    ----------
    name : str
        Its name in messages and provenance.

    """

    @property
    def name(self) -> str: ...  # noqa: D102

    def to_linear(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map code values in [0, 1] to linear light in [0, 1]."""

    def from_linear(self, light: NDArray[np.float32]) -> NDArray[np.floating]:
        """Map linear light in [0, 1] to code values in [0, 1]."""


@dataclass(frozen=True)
class Srgb:
    """The piecewise curve of sRGB [1]_, shared by Display P3."""

    @property
    def name(self) -> str:
        """The curve's name."""
        return "srgb"

    def to_linear(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map code values in [0, 1] to linear light in [0, 1]."""
        return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)

    def from_linear(self, light: NDArray[np.float32]) -> NDArray[np.floating]:
        """Map linear light in [0, 1] to code values in [0, 1]."""
        bent = np.float32(1.055) * light ** np.float32(1 / 2.4) - np.float32(0.055)
        return np.where(light <= np.float32(0.04045 / 12.92), np.float32(12.92) * light, bent)


@dataclass(frozen=True)
class Power:
    """A pure power: light = code ** gamma. With gamma 1, linear.

    Parameters
    ----------
    gamma : float
        The exponent, > 0.

    """

    gamma: float

    @property
    def name(self) -> str:
        """The curve's name."""
        return "linear" if self.gamma == 1 else f"gamma {self.gamma:.6g}"

    def to_linear(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map code values in [0, 1] to linear light in [0, 1]."""
        return values if self.gamma == 1 else values**self.gamma

    def from_linear(self, light: NDArray[np.float32]) -> NDArray[np.floating]:
        """Map linear light in [0, 1] to code values in [0, 1]."""
        return light if self.gamma == 1 else light ** np.float32(1 / self.gamma)


@dataclass(frozen=True, eq=False)
class Table:
    """A sampled curve, linear between its entries.

    Parameters
    ----------
    light : (N,) array of float64
        Linear light at N evenly spaced code values from 0 to 1, strictly rising, the last 1.

    Raises
    ------
    ValueError
        If the entries do not rise strictly, or so little that 16-bit codes are lost.

    """

    light: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check that all 16-bit codes survive decoding and encoding."""
        codes = np.arange(1 << 16, dtype=np.uint16)
        if np.any(np.diff(self.light) <= 0) or np.any(
            encode(decode(codes, self), self, 16) != codes
        ):
            msg = "a transfer table rises strictly"
            raise ValueError(msg)

    @property
    def name(self) -> str:
        """The curve's name."""
        return f"table of {len(self.light)}"

    def to_linear(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map code values in [0, 1] to linear light in [0, 1]."""
        return np.interp(values, np.linspace(0, 1, len(self.light)), self.light)

    def from_linear(self, light: NDArray[np.float32]) -> NDArray[np.floating]:
        """Map linear light in [0, 1] to code values in [0, 1]."""
        return np.interp(light, self.light, np.linspace(0, 1, len(self.light)))


SRGB = Srgb()
LINEAR = Power(1.0)
NAMED: dict[TransferName, Transfer] = {"srgb": SRGB, "linear": LINEAR, "gamma22": Power(2.2)}


def decode(codes: Codes, transfer: Transfer) -> NDArray[np.float32]:
    """Turn codes into linear light.

    Parameters
    ----------
    codes : array of uint8, uint16 or float32
        The file's values; the largest that the type holds, or 1, is the file's white.
    transfer : Transfer
        The file's curve.

    Returns
    -------
    array of float32, same shape
        Linear light; from integers, in [0, 1].

    """
    if codes.dtype.kind == "f":
        return linear_light(cast("NDArray[np.float32]", codes), transfer)
    top = np.iinfo(codes.dtype).max
    table = transfer.to_linear(np.arange(top + 1) / top).astype(np.float32)
    if codes.dtype == np.uint8 and codes.size:  # in a third of NumPy's time
        light = cv2.LUT(codes.reshape(-1, codes.shape[-1]), table)
        return np.asarray(light, np.float32).reshape(codes.shape)
    return table[codes]


def encode(light: NDArray[np.floating], transfer: Transfer, depth: Depth) -> Codes:
    """Turn linear light into the nearest codes; integer codes clip it to [0, 1].

    Parameters
    ----------
    light : array of float
        Linear light, 1 = the file's white.
    transfer : Transfer
        The file's curve.
    depth : {8, 16, 32}
        Bits a sample; 32 means floating-point numbers.

    Returns
    -------
    array of uint8, uint16 or float32, same shape
        The codes. Encoding the result of `decode` gives the same codes again.

    Raises
    ------
    ValueError
        If a value is not a number.

    """
    if depth == 32:
        return cast("Codes", display_values(light, transfer))
    kind = np.uint8 if depth == 8 else np.uint16
    top = np.float32((1 << depth) - 1)
    flat = np.ascontiguousarray(light, np.float32).reshape(-1)
    codes = np.empty(flat.shape, kind)
    for start in range(0, len(flat), _BLOCK):
        block = np.clip(flat[start : start + _BLOCK], 0, 1)
        if np.isnan(block).any():
            msg = "a pixel is not a number"
            raise ValueError(msg)
        codes[start : start + _BLOCK] = np.rint(transfer.from_linear(block) * top)
    return codes.reshape(light.shape)


def linear_light(values: NDArray[np.floating], transfer: Transfer) -> NDArray[np.float32]:
    """Turn display values, 1 = white, into linear light; they may exceed white."""
    return _beyond(values, transfer.to_linear)


def display_values(light: NDArray[np.floating], transfer: Transfer) -> NDArray[np.float32]:
    """Turn linear light into display values, 1 = white, without rounding; it may exceed white."""
    return _beyond(light, transfer.from_linear)


def is_clipped(codes: Codes) -> NDArray[np.bool_]:
    """Return where a code is clipped: 254 or 255 of 255, or at least that share of 65535.

    The code below the largest counts too, since JPEG's rounding changes saturated pixels by one.
    Floating-point numbers have no largest code.
    """
    if codes.dtype.kind == "f":
        return np.zeros(codes.shape, bool)
    top = np.iinfo(codes.dtype).max
    return np.asarray(codes >= round(top * 254 / 255))


def reduced_light(
    codes: Codes,
    transfer: Transfer,
    reduction: Callable[[NDArray[np.float32]], NDArray[np.float32]],
) -> NDArray[np.float32]:
    """Turn codes into linear light and reduce it to grey (H, W), band by band."""
    grey = np.empty(codes.shape[:2], np.float32)
    for top in range(0, len(codes), _BAND):
        grey[top : top + _BAND] = reduction(decode(codes[top : top + _BAND], transfer))
    return grey


def clipped_pixels(codes: Codes, saturated: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Return the pixels (H, W) of which a code is clipped, or `saturated`; band by band."""
    clipped = np.empty(codes.shape[:2], bool)
    for top in range(0, len(codes), _BAND):
        band = slice(top, top + _BAND)
        marks = is_clipped(codes[band]) if saturated is None else saturated[band]
        if marks.ndim == 3:  # NumPy's `any` over the colours takes ten times as long
            marks = marks[..., 0] | marks[..., 1] | marks[..., 2]
        clipped[band] = marks
    return clipped


def _beyond(
    values: NDArray[np.floating], curve: Callable[[NDArray[Any]], NDArray[np.floating]]
) -> NDArray[np.float32]:
    """Apply a curve to numbers that may lie outside [0, 1].

    The curve is odd. Above 1, a power continues, and a table continues as a straight line.
    """
    straight = isinstance(getattr(curve, "__self__", None), Table)
    flat = np.ascontiguousarray(values, np.float32).reshape(-1)
    result = np.empty(flat.shape, np.float32)
    for start in range(0, len(flat), _BLOCK):
        block = flat[start : start + _BLOCK]
        size = np.abs(block)
        bent = curve(np.minimum(size, 1)) + np.maximum(size - 1, 0) if straight else curve(size)
        np.copysign(bent, block, out=result[start : start + _BLOCK], casting="same_kind")
    return result.reshape(values.shape)
