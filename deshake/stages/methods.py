"""The catalogue of methods to deblur a photo, alone or with a noisy one.

The command line reads the catalogue for its options and checks. A method's function is imported
at its first use.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, get_args

from deshake.restore.quality import Quality
from deshake.run import Run

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
        Name of the method, as for ``--method``.
    module, function : str
        Module and name of its function.
    options : tuple of str
        Fields of `RestorationOptions` that it uses: ``quality``, ``iterations``.
    fixed : mapping
        Further arguments of the function.
    needs_noisy : bool
        Whether it needs a noisy photo of the same scene.
    inputs : tuple of str
        Further inputs from the noisy photo, beside the denoised photo: ``valid``,
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
        """Import and return its function."""
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
    """The method of the deblurring and its options.

    Parameters
    ----------
    method : str
        A name in `METHODS`: sparse gradients; Richardson-Lucy, Eq. (11), plain, accelerated, or
        with total variation; for uniform blur the Wiener filters of a library; with a noisy photo
        one energy of both photos (``fusion``) or Yuan's residual Richardson-Lucy.
    quality : {"fast", "default", "high"}
        Trade of time for quality, in sparse gradients and fusion.
    iterations : int, optional
        Number of iterations, >= 1; by default a number that suits the method and the photo.

    Raises
    ------
    ValueError
        If a name is unknown, or the method does not have an option.

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
        """Return the options that the method's function uses, as its arguments."""
        return {name: getattr(self, name) for name in METHODS[self.method].options}


def restore(
    g: NDArray[np.float32],
    kernel: RotationKernel,
    options: RestorationOptions | None = None,
    *,
    clipped: NDArray[np.bool_] | None = None,
    run: Run = Run(),
) -> Restoration:
    """Deblur a photo whose rotation kernel is known.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light, 1 where it clips.
    kernel : RotationKernel
        The blur, for a camera of the photo's size.
    options : RestorationOptions, optional
        Method and its options; by default sparse gradients.
    clipped, run
        The same as for `sparse_gradients`.

    Raises
    ------
    ValueError
        If the method needs a noisy photo, if the photo is not finite, if its size differs from that
        of the kernel's camera or of the clipped pixels, or if the iterations are fewer than 1.
    DeshakeError
        If the method is for uniform blur only and the blur varies, or its library is missing.

    """
    options = options or RestorationOptions()
    if options.needs_noisy:
        raise ValueError(f"{options.method} needs a noisy photo")
    return METHODS[options.method].load()(
        g, kernel, clipped=clipped, run=run, **options.arguments()
    )
