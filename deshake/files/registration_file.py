"""Registration files: the ``.npz`` schema between ``register`` and the stages that use it.

They are checked as strictly as kernel files.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from deshake.files.disk import write_bytes
from deshake.files.npz import Field, pack, unpack
from deshake.files.shared_keys import (
    CAMERA_FIELDS,
    MAX_TEXT,
    camera_arrays,
    camera_of,
    check_format,
    provenance_array,
    provenance_of,
    read_arrays,
)

if TYPE_CHECKING:
    import os

    from numpy.typing import NDArray

    from deshake.geometry.camera import Camera

__all__ = ["RegistrationFile", "read_registration", "registration_bytes", "write_registration"]

_MAX_BYTES: Final = 4 * MAX_TEXT + (1 << 20)  # a larger file is an error
_SCALE_RANGE: Final = (1e-6, 1e6)  # of photometric factors; beyond it is an error
_FIELDS: Final = {
    **CAMERA_FIELDS,
    "theta": Field("f", (3,)),
    "scale": Field("f"),
    "confidence": Field("f"),
    "provenance": Field("U", limit=MAX_TEXT),
}


@dataclass(frozen=True, eq=False)
class RegistrationFile:
    """The content of a registration file.

    Parameters
    ----------
    theta : (3,) array of float64
        The rotation from the noisy to the blurred photo, in radians.
    scale : float
        Photometric factor: multiplied by it, the noisy photo is as bright as the blurred photo.
    camera : Camera
        The camera of the blurred photo.
    confidence : float
        The confidence of the registration, 0..1.
    provenance : dict
        The origin of the registration: JSON data.

    """

    theta: NDArray[np.float64]
    scale: float
    camera: Camera
    confidence: float = 1.0
    provenance: dict[str, Any] = field(default_factory=dict)


def read_registration(path: str | os.PathLike[str]) -> RegistrationFile:
    """Read a registration file, ``-`` for standard input.

    Raises
    ------
    KernelFileError
        If it cannot be read or is not a registration file of this version.

    """
    return read_arrays(path, "registration", _parse, _MAX_BYTES)


def write_registration(
    path: str | os.PathLike[str], content: RegistrationFile, *, overwrite: bool = False
) -> None:
    """Write a registration file, ``-`` for standard output.

    Raises
    ------
    OutputError
        If the file may not or cannot be written.
    ValueError
        If the provenance is not JSON data.

    """
    write_bytes(path, registration_bytes(content), overwrite=overwrite)


def registration_bytes(content: RegistrationFile) -> bytes:
    """Return the bytes of a registration file; raise ValueError if the provenance is not JSON."""
    arrays = camera_arrays(content.camera) | {
        "theta": np.asarray(content.theta, np.float64),
        "scale": np.float64(content.scale),
        "confidence": np.float64(content.confidence),
        "provenance": provenance_array(content.provenance),
    }
    return pack(arrays)


def _parse(data: bytes) -> RegistrationFile:
    check_format(data)
    arrays = unpack(data, _FIELDS)
    for name in ("theta", "scale", "confidence"):
        if not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name!r} is not finite")
    theta, scale = arrays["theta"], float(arrays["scale"])
    if np.abs(theta).max() > np.pi or (theta**2).sum() > np.pi**2 * (1 + 1e-12):
        raise ValueError("'theta' is a rotation by more than pi")
    if not _SCALE_RANGE[0] <= scale <= _SCALE_RANGE[1]:
        raise ValueError(f"'scale' is {scale:g}, not between 1e-6 and 1e6")
    confidence = float(arrays["confidence"])
    if not 0 <= confidence <= 1:
        raise ValueError(f"'confidence' is {confidence:g}, not between 0 and 1")
    return RegistrationFile(theta, scale, camera_of(arrays), confidence, provenance_of(arrays))
