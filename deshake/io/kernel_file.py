"""Camera and kernel files: the ``.npz`` schemas between the stages, version 1.

A file from another version, or one with anything missing, misshapen or out of range, is refused
with one line that says what is wrong. Keys that are not in the schema are ignored.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from deshake.errors import KernelFileError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.io.files import read_bytes, write_bytes
from deshake.io.npz import Field, pack, unpack

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from numpy.typing import NDArray

_T = TypeVar("_T")

__all__ = [
    "FORMAT",
    "MAX_WEIGHTS",
    "CameraFile",
    "KernelFile",
    "read_camera",
    "read_kernel",
    "write_camera",
    "write_kernel",
]

FORMAT: Final = 1
"""Version of the schemas that is written and read."""

MAX_WEIGHTS: Final = 2_000_000
"""Rotations of the largest kernel that is read."""

_MAX_TEXT: Final = 1 << 20
_MAX_SIDE: Final = 1_000_000
_MAX_BYTES: Final = 32 * MAX_WEIGHTS + 4 * _MAX_TEXT + (1 << 20)
_SUM_TOLERANCE: Final = 1e-6
_ROUNDING: Final = 1e-12  # a sum this close to 1 is 1: dividing by it would only add noise
_DISTORTION_LENGTHS: Final = (0, 4, 5, 8, 12, 14)  # OpenCV's models
_FOCAL_RANGE: Final = (1e-2, 1e5)  # in longer sides; the uniform model's is 1000

_CAMERA_FIELDS: Final = {
    "camera_matrix": Field("f", (3, 3)),
    "image_size": Field("i", (2,)),
    "distortion": Field("f", (None,)),
}
_KERNEL_FIELDS: Final = {
    "theta": Field("f", (None, 3), 3 * MAX_WEIGHTS),
    "weights": Field("f", (None,), MAX_WEIGHTS),
    "steps": Field("f", (3,)),
    "confidence": Field("f"),
    "provenance": Field("U", limit=_MAX_TEXT),
}


def _no_distortion() -> NDArray[np.float64]:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class CameraFile:
    """What a camera file holds.

    Parameters
    ----------
    camera : Camera
        The camera.
    source : str
        Which tag or option gave the focal length.
    distortion : (k,) array of float64
        Lens distortion in OpenCV's order (k1, k2, p1, p2, k3, ...); empty: none.

    """

    camera: Camera
    source: str
    distortion: NDArray[np.float64] = field(default_factory=_no_distortion)


@dataclass(frozen=True, eq=False)
class KernelFile:
    """What a kernel file holds.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel, with its camera.
    confidence : float
        How far the estimate is to be trusted, from 0 to 1.
    provenance : dict
        How the kernel came about: JSON data.
    distortion : (k,) array of float64
        Lens distortion in OpenCV's order; empty: none.

    """

    kernel: RotationKernel
    confidence: float = 1.0
    provenance: dict[str, Any] = field(default_factory=dict)
    distortion: NDArray[np.float64] = field(default_factory=_no_distortion)


def read_camera(path: str | os.PathLike[str]) -> CameraFile:
    """Read a camera file, ``-`` for standard input.

    Raises
    ------
    KernelFileError
        If it cannot be read or is not a camera file of this version.

    """
    return _read(path, "camera", _parse_camera)


def read_kernel(path: str | os.PathLike[str]) -> KernelFile:
    """Read a kernel file, ``-`` for standard input.

    Weights that sum to 1 within 1e-6 are scaled to sum to 1.

    Raises
    ------
    KernelFileError
        If it cannot be read or is not a kernel file of this version.

    """
    return _read(path, "kernel", _parse_kernel)


def write_camera(
    path: str | os.PathLike[str], content: CameraFile, *, overwrite: bool = False
) -> None:
    """Write a camera file, ``-`` for standard output.

    Raises
    ------
    OutputError
        If the file may not or cannot be written.

    """
    arrays = _camera_arrays(content.camera, content.distortion)
    write_bytes(path, pack(arrays | {"source": np.array(content.source)}), overwrite=overwrite)


def write_kernel(
    path: str | os.PathLike[str], content: KernelFile, *, overwrite: bool = False
) -> None:
    """Write a kernel file, ``-`` for standard output.

    Raises
    ------
    OutputError
        If the file may not or cannot be written.
    ValueError
        If the provenance is not JSON data.

    """
    kernel = content.kernel
    provenance = json.dumps(content.provenance, sort_keys=True, allow_nan=False)
    arrays = _camera_arrays(kernel.camera, content.distortion) | {
        "theta": np.asarray(kernel.theta, np.float64),
        "weights": np.asarray(kernel.weights, np.float64),
        "steps": np.asarray(kernel.steps, np.float64),
        "confidence": np.float64(content.confidence),
        "provenance": np.array(provenance),
    }
    write_bytes(path, pack(arrays), overwrite=overwrite)


def _camera_arrays(camera: Camera, distortion: NDArray[np.float64]) -> dict[str, Any]:
    return {
        "format": np.int64(FORMAT),
        "camera_matrix": np.asarray(camera.matrix, np.float64),
        "image_size": np.array(camera.shape, np.int64),
        "distortion": np.asarray(distortion, np.float64),
    }


def _read(path: str | os.PathLike[str], what: str, parse: Callable[[bytes], _T]) -> _T:
    data = read_bytes(path, _MAX_BYTES, KernelFileError)
    try:
        return parse(data)
    except ValueError as error:
        raise KernelFileError(
            f"no usable {what} file: {error}",
            hint=f"docs/kernel-files.md describes what a {what} file holds",
            file=path,
        ) from error


def _parse_camera(data: bytes) -> CameraFile:
    _check_format(data)
    arrays = unpack(data, _CAMERA_FIELDS | {"source": Field("U", limit=_MAX_TEXT)})
    source = _text(arrays["source"], "source")
    if not source.isprintable():
        raise ValueError("'source' is not a line of text")
    return CameraFile(_camera(arrays), source, _distortion(arrays))


def _parse_kernel(data: bytes) -> KernelFile:
    _check_format(data)
    arrays = unpack(data, _CAMERA_FIELDS | _KERNEL_FIELDS)
    theta, weights, steps = arrays["theta"], arrays["weights"], arrays["steps"]
    if len(weights) == 0 or len(theta) != len(weights):
        raise ValueError(f"{len(theta)} rotations in 'theta', {len(weights)} in 'weights'")
    for name in ("theta", "weights", "steps", "confidence"):
        if not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name!r} is not finite")
    if np.abs(theta).max() > np.pi or (theta**2).sum(1).max() > np.pi**2 * (1 + 1e-12):
        raise ValueError("'theta' holds a rotation by more than pi")
    if weights.min() < 0:
        raise ValueError("'weights' holds a negative weight")
    with np.errstate(over="ignore"):
        total = float(weights.sum())
    if not abs(total - 1) <= _SUM_TOLERANCE:
        raise ValueError(f"'weights' sum to {total:.9g}, not 1")
    if abs(total - 1) > _ROUNDING:
        weights = weights / total
    if steps.min() <= 0 or steps.max() > np.pi:
        raise ValueError("'steps' are not all between 0 and pi")
    confidence = float(arrays["confidence"])
    if not 0 <= confidence <= 1:
        raise ValueError(f"'confidence' is {confidence:g}, not between 0 and 1")
    kernel = RotationKernel(theta, weights, steps, _camera(arrays))
    return KernelFile(kernel, confidence, _provenance(arrays), _distortion(arrays))


def _check_format(data: bytes) -> None:
    """Refuse other versions first: their other keys may mean anything."""
    version = int(unpack(data, {"format": Field("i")})["format"])
    if version != FORMAT:
        raise ValueError(f"its format is {version}; this version of deshake reads {FORMAT}")


def _camera(arrays: dict[str, NDArray[Any]]) -> Camera:
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
    return Camera(matrix, height, width)


def _distortion(arrays: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
    values: NDArray[np.float64] = arrays["distortion"]
    if len(values) not in _DISTORTION_LENGTHS or not np.isfinite(values).all():
        raise ValueError("'distortion' is not 0, 4, 5, 8, 12 or 14 finite numbers")
    return values


def _provenance(arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    text = _text(arrays["provenance"], "provenance")
    try:
        provenance = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise ValueError("'provenance' is not JSON") from error
    if not isinstance(provenance, dict):
        raise ValueError("'provenance' is not a JSON object")  # noqa: TRY004
    return provenance


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def _text(array: NDArray[Any], key: str) -> str:
    try:
        return str(array.item())
    except ValueError as error:  # code points that no character has
        raise ValueError(f"{key!r} is not text") from error
