"""HEIC in: photos of telephones, and of cameras that write 10 bits.

libheif decodes, turns and crops the picture as the file demands. The orientation in EXIF no longer
applies. deshake does not write HEIC: its encoders are not free. pi-heif is an optional package.
"""

from __future__ import annotations

import importlib
import io
from typing import Any, Final

import numpy as np

from deshake.errors import PhotoError
from deshake.formats.encoding import Decoded, Encoding, check_stated_size, decoding
from deshake.metadata.metadata import Metadata
from deshake.metadata.profiles import cicp_profile

__all__ = ["decode_heif"]

_GAIN_MAPS: Final = ("gainmap", "gain-map")


def decode_heif(data: bytes) -> Decoded:
    """Decode the main picture of a HEIC: 8 bits to 8 bits, 10 or 12 bits to 16.

    Raises
    ------
    PhotoError
        If pi-heif is not installed; if the file is damaged or cut short, too large, or HDR.

    """
    try:
        pi_heif: Any = importlib.import_module("pi_heif")
    except ImportError as error:
        raise PhotoError(
            "a HEIC file, which cannot be read here", hint="pip install 'deshake[heif]'"
        ) from error
    with decoding("HEIC"):
        file = pi_heif.open_heif(io.BytesIO(data), convert_hdr_to_8bit=False)
        picture = file[file.primary_index]
        check_stated_size(picture.size[1], picture.size[0], len(data))
        info = picture.info
        icc = info.get("icc_profile", b"") or _profile_by_numbers(info.get("nclx_profile", {}))
        pixels = np.atleast_3d(np.array(picture))  # a copy: the memory belongs to the file
        exif = (info.get("exif") or b"").removeprefix(b"Exif\0\0")
        metadata = Metadata(exif, info.get("xmp", b""), icc).upright()
    bits = info["bit_depth"]
    if bits > 8:  # pi-heif shifts the codes to the left
        pixels = np.rint((pixels >> (16 - bits)) * (65535 / ((1 << bits) - 1))).astype(np.uint16)
    grey = pixels.shape[2] < 3
    codes = pixels[..., 0] if grey else pixels[..., :3]
    return Decoded(
        np.ascontiguousarray(codes),
        np.ascontiguousarray(pixels[..., -1]) if picture.has_alpha else None,
        Encoding("HEIF", depth=16 if bits > 8 else 8, bits=bits if bits > 8 else 0, grey=grey),
        metadata,
        notes=tuple(_dropped(info, len(file))),
    )


def _profile_by_numbers(numbers: dict[str, Any]) -> bytes:
    """Make the profile for the code numbers of the colours; empty for sRGB."""
    return cicp_profile(
        int(numbers.get("color_primaries", 2)), int(numbers.get("transfer_characteristics", 2))
    )


def _dropped(info: dict[str, Any], count: int) -> list[str]:
    """List what the file holds and the result does not."""
    kinds = info.get("aux", {})
    notes = []
    if any(name in kind.lower() for kind in kinds for name in _GAIN_MAPS):
        notes.append("its gain map (HDR) is dropped")
    if info.get("depth_images"):
        notes.append("its depth map is dropped")
    if count > 1:
        notes.append(f"the first of {count} pictures; the others are dropped")
    return notes
