"""Restoration by name: sparse gradients, the variants of Richardson-Lucy, and the baselines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal, get_args

from deshake.restore.richardson_lucy import richardson_lucy, richardson_lucy_tv
from deshake.restore.sparse_gradients import Quality, sparse_gradients
from deshake.restore.wiener import unsupervised_wiener, wiener

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel
    from deshake.restore.restoration import Restoration

__all__ = ["BY_DEFAULT", "Method", "RestorationOptions", "restore"]

Method = Literal["sparse", "rl", "rl-accelerated", "rl-tv", "wiener", "unsupervised-wiener"]
"""How a photo is deblurred once its kernel is known."""

_METHODS: dict[str, Callable[..., Restoration]] = {
    "rl": partial(richardson_lucy, accelerated=False),
    "rl-accelerated": richardson_lucy,
    "rl-tv": richardson_lucy_tv,
    "wiener": wiener,
    "unsupervised-wiener": unsupervised_wiener,
}


@dataclass(frozen=True)
class RestorationOptions:
    """How a photo is deblurred, beside its kernel.

    Parameters
    ----------
    method : {"sparse", "rl", "rl-accelerated", "rl-tv", "wiener", "unsupervised-wiener"}
        By sparse gradients; by Richardson-Lucy, Eq. (11), as it is, accelerated, or with total
        variation; or, if the blur is uniform, by the Wiener filters of a library.
    quality : {"fast", "default", "high"}
        How much time sparse gradients take.
    iterations : int, optional
        How many the method does, >= 1; by default what suits the method and the photo.

    Raises
    ------
    ValueError
        If a name is unknown, or a choice does not go with the method.

    """

    method: Method = "sparse"
    quality: Quality = "default"
    iterations: int | None = None

    def __post_init__(self) -> None:
        """Check the choices."""
        if self.method not in get_args(Method) or self.quality not in get_args(Quality):
            raise ValueError(f"no method {self.method!r} of quality {self.quality!r}")
        if self.method != "sparse" and self.quality != "default":
            raise ValueError(f"{self.method} has one quality only")
        if self.method == "wiener" and self.iterations is not None:
            raise ValueError("a Wiener filter has no iterations")


BY_DEFAULT = RestorationOptions()
"""Sparse gradients, at default quality."""


def restore(
    g: NDArray[np.float32],
    kernel: RotationKernel,
    options: RestorationOptions,
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
    options : RestorationOptions
        How.
    clipped, threads, progress
        As for `sparse_gradients`.

    Raises
    ------
    ValueError
        If the photo is not finite or does not fit the kernel's camera or the clipped pixels, or
        the iterations are fewer than 1.
    DeshakeError
        If the method is for uniform blur only and this is none, or its library is missing.

    """
    method = _METHODS.get(options.method) or partial(sparse_gradients, quality=options.quality)
    return method(
        g,
        kernel,
        clipped=clipped,
        iterations=options.iterations,
        threads=threads,
        progress=progress,
    )
