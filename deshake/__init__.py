"""deshake removes camera-rotation shake from photographs (Whyte et al., CVPR 2010).

The names below are the public interface. Each is imported at its first use, so ``import deshake``
costs nothing. Pictures are arrays of floats in linear light, of shape (H, W) or (H, W, 3), or
photos that were read from files.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

from deshake.version import __version__

if TYPE_CHECKING:
    from deshake.api.cameras import calibrate
    from deshake.api.deblurred import deblur
    from deshake.api.estimates import estimate_blind, estimate_pair, register
    from deshake.api.simulated import Simulation, simulate
    from deshake.api.written import write_kernel, write_photo
    from deshake.errors import DeshakeError
    from deshake.files.kernel_file import KernelFile, read_kernel
    from deshake.formats.photo import Photo, read_photo
    from deshake.geometry.camera import Camera
    from deshake.geometry.kernel import RotationKernel
    from deshake.pair.registration import Registration
    from deshake.pictures.render import render_comparison, render_filters, render_kernel
    from deshake.stages.estimate_result import Estimate

__all__ = [
    "Camera",
    "DeshakeError",
    "Estimate",
    "KernelFile",
    "Photo",
    "Registration",
    "RotationKernel",
    "Simulation",
    "__version__",
    "calibrate",
    "deblur",
    "estimate_blind",
    "estimate_pair",
    "read_kernel",
    "read_photo",
    "register",
    "render_comparison",
    "render_filters",
    "render_kernel",
    "simulate",
    "write_kernel",
    "write_photo",
]

_HOMES: Final = {
    "Camera": "deshake.geometry.camera",
    "DeshakeError": "deshake.errors",
    "Estimate": "deshake.stages.estimate_result",
    "KernelFile": "deshake.files.kernel_file",
    "Photo": "deshake.formats.photo",
    "Registration": "deshake.pair.registration",
    "RotationKernel": "deshake.geometry.kernel",
    "Simulation": "deshake.api.simulated",
    "calibrate": "deshake.api.cameras",
    "deblur": "deshake.api.deblurred",
    "estimate_blind": "deshake.api.estimates",
    "estimate_pair": "deshake.api.estimates",
    "read_kernel": "deshake.files.kernel_file",
    "read_photo": "deshake.formats.photo",
    "register": "deshake.api.estimates",
    "render_comparison": "deshake.pictures.render",
    "render_filters": "deshake.pictures.render",
    "render_kernel": "deshake.pictures.render",
    "simulate": "deshake.api.simulated",
    "write_kernel": "deshake.api.written",
    "write_photo": "deshake.api.written",
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
