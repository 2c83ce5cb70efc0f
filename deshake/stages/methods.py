"""The catalogue of methods: how a photo is deblurred, alone or with a noisy one.

The command line reads the catalogue for its options and checks. A method's function is imported
when it is first used.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, get_args

from deshake.restore.quality import Quality

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel
    from deshake.restore.restoration import Restoration

__all__ = ["METHODS", "Method", "RestorationOptions", "default_method", "restore"]


@dataclass(frozen=True)
class Method:
    """A way to deblur a photo whose kernel is known.

    Parameters
    ----------
    name : str
        What ``--method`` takes.
    module, function : str
        Where its function is.
    options : tuple of str
        Fields of `RestorationOptions` that it takes: ``quality``, ``iterations``.
    fixed : mapping
        Further arguments of the function.
    needs_noisy : bool
        Whether it needs a noisy photo of the same scene.
    inputs : tuple of str
        What it takes of the noisy photo beside the denoised photo itself: ``valid``,
        ``noisy_clipped``.

    """

    name: str
    module: str
    function: str
    options: tuple[str, ...] = ("iterations",)
    fixed: Mapping[str, Any] = field(default_factory=dict)
    needs_noisy: bool = False
    inputs: tuple[str, ...] = ()

    def load(self) -> Callable[..., Restoration]:
        """Import its function."""
        function: Callable[..., Restoration] = getattr(import_module(self.module), self.function)
        return partial(function, **self.fixed)


METHODS: Final = {
    method.name: method
    for method in (
        Method(
            "sparse",
            "deshake.restore.sparse_gradients",
            "sparse_gradients",
            options=("quality", "iterations"),
        ),
        Method(
            "rl",
            "deshake.restore.richardson_lucy",
            "richardson_lucy",
            fixed={"accelerated": False},
        ),
        Method("rl-accelerated", "deshake.restore.richardson_lucy", "richardson_lucy"),
        Method("rl-tv", "deshake.restore.richardson_lucy", "richardson_lucy_tv"),
        Method("wiener", "deshake.restore.wiener", "wiener", options=()),
        Method("unsupervised-wiener", "deshake.restore.wiener", "unsupervised_wiener"),
        Method(
            "fusion",
            "deshake.pair.fusion",
            "fuse",
            options=("quality", "iterations"),
            needs_noisy=True,
            inputs=("valid", "noisy_clipped"),
        ),
        Method(
            "residual",
            "deshake.pair.residual",
            "residual_richardson_lucy",
            needs_noisy=True,
        ),
    )
}
"""All methods by their names, in the order in which the help lists them."""


def default_method(*, noisy: bool) -> str:
    """Return the name of the default method, with a noisy photo or without."""
    return "fusion" if noisy else "sparse"


@dataclass(frozen=True)
class RestorationOptions:
    """How a photo is deblurred, beside its kernel.

    Parameters
    ----------
    method : str
        A name in `METHODS`: by sparse gradients; by Richardson-Lucy, Eq. (11), as it is,
        accelerated, or with total variation; if the blur is uniform, by the Wiener filters of a
        library; with a noisy photo by both photos in one energy (``fusion``) or by Yuan's residual
        Richardson-Lucy.
    quality : {"fast", "default", "high"}
        How much time sparse gradients and the fusion take.
    iterations : int, optional
        How many the method does, >= 1; by default what suits the method and the photo.

    Raises
    ------
    ValueError
        If a name is unknown, or a choice does not go with the method.

    """

    method: str = "sparse"
    quality: Quality = "default"
    iterations: int | None = None

    def __post_init__(self) -> None:
        """Check the choices."""
        if self.method not in METHODS or self.quality not in get_args(Quality):
            raise ValueError(f"no method {self.method!r} of quality {self.quality!r}")
        takes = METHODS[self.method].options
        if "quality" not in takes and self.quality != "default":
            raise ValueError(f"{self.method} has one quality only")
        if "iterations" not in takes and self.iterations is not None:
            raise ValueError(f"{self.method} has no iterations")

    @property
    def needs_noisy(self) -> bool:
        """Whether the method needs a noisy photo of the same scene."""
        return METHODS[self.method].needs_noisy

    def arguments(self) -> dict[str, Any]:
        """Return what the method's function takes of the options."""
        return {name: getattr(self, name) for name in METHODS[self.method].options}


def restore(
    g: NDArray[np.float32],
    kernel: RotationKernel,
    options: RestorationOptions | None = None,
    *,
    clipped: NDArray[np.bool_] | None = None,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Restoration:
    """Deblur a photo whose rotation kernel is known.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light, 1 where it clips.
    kernel : RotationKernel
        The blur, for a camera of the photo's size.
    options : RestorationOptions, optional
        How; by default by sparse gradients.
    clipped, threads, progress
        As for `sparse_gradients`.

    Raises
    ------
    ValueError
        If the method needs a noisy photo, the photo is not finite or does not fit the kernel's
        camera or the clipped pixels, or the iterations are fewer than 1.
    DeshakeError
        If the method is for uniform blur only and this is none, or its library is missing.

    """
    options = options or RestorationOptions()
    if options.needs_noisy:
        raise ValueError(f"{options.method} needs a noisy photo")
    return METHODS[options.method].load()(
        g, kernel, clipped=clipped, threads=threads, progress=progress, **options.arguments()
    )
