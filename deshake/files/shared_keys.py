"""The common keys of camera, kernel and registration files: version, camera, provenance."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from deshake.errors import KernelFileError
from deshake.files.disk import read_bytes
from deshake.files.npz import Field, unpack
from deshake.geometry.camera import Camera

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

_T = TypeVar("_T")

__all__ = [
    "CAMERA_FIELDS",
    "FORMAT",
    "MAX_TEXT",
    "camera_arrays",
    "camera_of",
    "check_format",
    "provenance_array",
    "provenance_of",
    "read_arrays",
    "text_of",
]

FORMAT: Final = 1
"""Version of the schemas that deshake writes and reads."""

MAX_TEXT: Final = 1 << 20
"""Length of the longest text that is read, in characters."""

CAMERA_FIELDS: Final = {
    "camera_matrix": Field("f", (3, 3)),
    "image_size": Field("i", (2,)),
    "distortion": Field("f", (None,)),
}
"""The arrays of a camera."""

_MAX_SIDE: Final = 1_000_000  # px: a larger side of a picture is an error
_FOCAL_RANGE: Final = (1e-2, 1e5)  # in longer sides of the photo; the uniform model has 1000


def read_arrays(
    path: str | os.PathLike[str], what: str, parse: Callable[[bytes], _T], limit: int
) -> _T:
    """Read a file of at most `limit` bytes and parse it; ``-`` is standard input.

    Raises
    ------
    KernelFileError
        If it cannot be read, or `parse` raises ValueError.

    """
    data = read_bytes(path, limit, KernelFileError)
    try:
        return parse(data)
    except ValueError as error:
        raise KernelFileError(
            f"no usable {what} file: {error}",
            hint=f"docs/kernel-files.md describes what a {what} file holds",
            file=path,
        ) from error


def check_format(data: bytes) -> None:
    """Refuse other versions first: their other keys may have other meanings."""
    version = int(unpack(data, {"format": Field("i")})["format"])
    if version != FORMAT:
        raise ValueError(f"its format is {version}; this version of deshake reads {FORMAT}")


def camera_arrays(camera: Camera) -> dict[str, Any]:
    """Return the arrays of the format's version and the camera."""
    return {
        "format": np.int64(FORMAT),
        "camera_matrix": np.asarray(camera.matrix, np.float64),
        "image_size": np.array(camera.shape, np.int64),
        "distortion": np.asarray(camera.distortion, np.float64),
    }


def camera_of(arrays: Mapping[str, NDArray[Any]]) -> Camera:
    """Make the camera; raise ValueError if it is absurd."""
    matrix = arrays["camera_matrix"]
    height, width = (int(side) for side in arrays["image_size"])
    if not (1 <= height <= _MAX_SIDE and 1 <= width <= _MAX_SIDE):
        raise ValueError(f"'image_size' is {height} x {width}")
    if not np.isfinite(matrix).all() or np.any(matrix[[1, 2, 2, 2], [0, 0, 1, 2]] != (0, 0, 0, 1)):
        raise ValueError("'camera_matrix' is not of the form [[f, s, x], [0, f, y], [0, 0, 1]]")
    focal, side = np.array([matrix[0, 0], matrix[1, 1]]), max(height, width)
    low, high = _FOCAL_RANGE
    if focal.min() < low * side or focal.max() > high * side or focal.max() > 2 * focal.min():
        raise ValueError("'camera_matrix' holds an absurd focal length")
    if abs(matrix[0, 1]) > focal.min() or np.abs(matrix[:2, 2]).max() > 1000 * side:
        raise ValueError("'camera_matrix' holds an absurd skew or principal point")
    return Camera(matrix, height, width, arrays["distortion"])


def provenance_array(provenance: Mapping[str, Any]) -> NDArray[np.str_]:
    """Return the provenance as JSON text; raise ValueError if it is not JSON data."""
    return np.array(json.dumps(provenance, sort_keys=True, allow_nan=False))


def provenance_of(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Read the provenance; raise ValueError if it is not a JSON object."""
    text = text_of(arrays["provenance"], "provenance")
    try:
        provenance = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise ValueError("'provenance' is not JSON") from error
    if not isinstance(provenance, dict):
        raise ValueError("'provenance' is not a JSON object")  # noqa: TRY004
    return provenance


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def text_of(array: NDArray[Any], key: str) -> str:
    """Read a text; raise ValueError if the array is no text."""
    try:
        return str(array.item())
    except (ValueError, SystemError) as error:  # code points without a character
        raise ValueError(f"{key!r} is not text") from error
