"""deshake removes camera-rotation shake from photographs (Whyte et al., CVPR 2010).

The names below are the public interface; each is imported when it is first asked for, so that
``import deshake`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

from deshake.version import __version__

if TYPE_CHECKING:
    from deshake.errors import DeshakeError
    from deshake.files.kernel_file import read_kernel, write_kernel
    from deshake.formats.photo import Photo, read_photo, write_photo
    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel
    from deshake.pictures.render import render_comparison, render_filters, render_kernel

__all__ = [
    "Camera",
    "DeshakeError",
    "Photo",
    "RotationKernel",
    "__version__",
    "read_kernel",
    "read_photo",
    "render_comparison",
    "render_filters",
    "render_kernel",
    "write_kernel",
    "write_photo",
]

_HOMES: Final = {
    "Camera": "deshake.geometry.camera",
    "DeshakeError": "deshake.errors",
    "Photo": "deshake.formats.photo",
    "RotationKernel": "deshake.geometry.kernel",
    "read_kernel": "deshake.files.kernel_file",
    "read_photo": "deshake.formats.photo",
    "render_comparison": "deshake.pictures.render",
    "render_filters": "deshake.pictures.render",
    "render_kernel": "deshake.pictures.render",
    "write_kernel": "deshake.files.kernel_file",
    "write_photo": "deshake.formats.photo",
}


def __getattr__(name: str) -> object:
    """Import a public name from its room."""
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
