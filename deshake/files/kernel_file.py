"""Camera and kernel files: the ``.npz`` schemas between the stages, version 1.

A file of another version is refused, and so is a file with a missing array, a wrong shape or a
value out of range. One line states the error. Keys that are not in the schema are ignored.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from deshake.files.disk import write_bytes
from deshake.files.npz import Field, pack, unpack
from deshake.files.shared_keys import (
    CAMERA_FIELDS,
    FORMAT,
    MAX_TEXT,
    camera_arrays,
    camera_of,
    check_format,
    provenance_array,
    provenance_of,
    read_arrays,
    text_of,
)
from deshake.geometry.kernel import RotationKernel

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from deshake.geometry.camera import Camera

__all__ = [
    "FORMAT",
    "MAX_WEIGHTS",
    "CameraFile",
    "KernelFile",
    "kernel_bytes",
    "read_camera",
    "read_kernel",
    "write_camera",
    "write_kernel",
]

MAX_WEIGHTS: Final = 2_000_000
"""Rotations of the largest kernel that is read."""

_MAX_BYTES: Final = 32 * MAX_WEIGHTS + 4 * MAX_TEXT + (1 << 20)  # a larger file is an error
_SUM_TOLERANCE: Final = 1e-6  # weights whose sum differs from 1 by more are an error
_ROUNDING: Final = 1e-12  # a sum this close to 1 counts as 1: a division would only add noise
_KERNEL_FIELDS: Final = {
    "theta": Field("f", (None, 3), 3 * MAX_WEIGHTS),
    "weights": Field("f", (None,), MAX_WEIGHTS),
    "steps": Field("f", (3,)),
    "confidence": Field("f"),
    "provenance": Field("U", limit=MAX_TEXT),
}


@dataclass(frozen=True, eq=False)
class CameraFile:
    """The content of a camera file.

    Parameters
    ----------
    camera : Camera
        The camera.
    source : str
        The tag or option that gave the focal length.

    """

    camera: Camera
    source: str


@dataclass(frozen=True, eq=False)
class KernelFile:
    """The content of a kernel file.

    Parameters
    ----------
    kernel : RotationKernel
        The kernel, with its camera.
    confidence : float
        The confidence of the estimate, 0..1.
    provenance : dict
        The origin of the kernel: JSON data.

    """

    kernel: RotationKernel
    confidence: float = 1.0
    provenance: dict[str, Any] = field(default_factory=dict)


def read_camera(path: str | os.PathLike[str]) -> CameraFile:
    """Read a camera file, ``-`` for standard input.

    Raises
    ------
    KernelFileError
        If it cannot be read or is not a camera file of this version.

    """
    return read_arrays(path, "camera", _parse_camera, _MAX_BYTES)


def read_kernel(path: str | os.PathLike[str]) -> KernelFile:
    """Read a kernel file.

    Weights that sum to 1 within 1e-6 are scaled to sum to 1.

    Parameters
    ----------
    path : path
        The file; ``-`` for standard input.

    Returns
    -------
    KernelFile
        With ``kernel``, ``confidence`` (0..1) and ``provenance``.

    Raises
    ------
    KernelFileError
        If it cannot be read or is not a kernel file of this version.

    Examples
    --------
    >>> import deshake
    >>> camera = deshake.Camera.from_focal(900.0, height=480, width=720)
    >>> deshake.write_kernel("still.npz", deshake.RotationKernel.delta(camera))
    >>> content = deshake.read_kernel("still.npz")
    >>> content.kernel.camera.shape, content.confidence, content.provenance
    ((480, 720), 1.0, {})

    """
    return read_arrays(path, "kernel", _parse_kernel, _MAX_BYTES)


def write_camera(
    path: str | os.PathLike[str],
    content: CameraFile,
    *,
    overwrite: bool = False,
    made_from: Sequence[str | os.PathLike[str]] = (),
) -> None:
    """Write a camera file, ``-`` for standard output; it takes the permissions of its inputs.

    Raises
    ------
    OutputError
        If the file may not or cannot be written.

    """
    arrays = camera_arrays(content.camera) | {"source": np.array(content.source)}
    write_bytes(path, pack(arrays), overwrite=overwrite, made_from=made_from)


def write_kernel(
    path: str | os.PathLike[str],
    content: KernelFile,
    *,
    overwrite: bool = False,
    made_from: Sequence[str | os.PathLike[str]] = (),
) -> None:
    """Write a kernel file, ``-`` for standard output; it takes the permissions of its inputs.

    Raises
    ------
    OutputError
        If the file may not or cannot be written.
    ValueError
        If the provenance is not JSON data.

    """
    write_bytes(path, kernel_bytes(content), overwrite=overwrite, made_from=made_from)


def kernel_bytes(content: KernelFile) -> bytes:
    """Return the bytes of a kernel file; raise ValueError if the provenance is not JSON data."""
    kernel = content.kernel
    arrays = camera_arrays(kernel.camera) | {
        "theta": np.asarray(kernel.theta, np.float64),
        "weights": np.asarray(kernel.weights, np.float64),
        "steps": np.asarray(kernel.steps, np.float64),
        "confidence": np.float64(content.confidence),
        "provenance": provenance_array(content.provenance),
    }
    return pack(arrays)


def _parse_camera(data: bytes) -> CameraFile:
    check_format(data)
    arrays = unpack(data, CAMERA_FIELDS | {"source": Field("U", limit=MAX_TEXT)})
    source = text_of(arrays["source"], "source")
    if not source.isprintable():
        raise ValueError("'source' is not a line of text")
    return CameraFile(camera_of(arrays), source)


def _parse_kernel(data: bytes) -> KernelFile:
    check_format(data)
    arrays = unpack(data, CAMERA_FIELDS | _KERNEL_FIELDS)
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
    kernel = RotationKernel(theta, weights, steps, camera_of(arrays))
    return KernelFile(kernel, confidence, provenance_of(arrays))
