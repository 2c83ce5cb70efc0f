"""Restoration with a denoiser in it, after a first estimate: sharper texture, calmer flat parts.

Sparse gradients know edges, but not that a structure comes again; non-local means know that, and
leave ripples of the blur beside lone edges. In the half-quadratic splitting each judges what it
knows: w is the shrunk gradients, at a cost that rises from stage to stage, and v the denoised s f,
in whose units the noise is t everywhere; t falls, and v costs alpha / t^2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deshake.signal.non_local_means import non_local_means

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.signal.half_quadratic import HalfQuadratic

__all__ = ["plug_and_play"]

_RHO = (0.03, 1.0)
_NOISE = (5.0, 0.7)  # t: what the denoiser takes for noise, first and last
_ALPHA = 0.4


def plug_and_play(
    descent: HalfQuadratic, *, stages: int, progress: Callable[[float, str], None]
) -> None:
    """Improve an estimate of the sharp photo.

    Parameters
    ----------
    descent : HalfQuadratic
        The estimate; it is changed.
    stages : int
        How many, >= 1.
    progress : callable
        Told the fraction done, 0 to 1, and what is being done, after each stage.

    """
    rhos, noises = (np.geomspace(*ends[::-1], stages)[::-1] for ends in (_RHO, _NOISE))
    for stage, (rho, noise) in enumerate(zip(rhos, noises, strict=True), 1):
        v = non_local_means(descent.f * descent.s, float(noise), threads=descent.threads)
        descent.step(float(rho), _ALPHA / float(noise) ** 2, v)
        progress(stage / stages, f"deblurring finely, stage {stage}")
