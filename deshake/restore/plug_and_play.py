"""Stages with a denoiser, after a first estimate: sharper texture, calmer flat parts.

The prior of sparse gradients models edges, but not repeated structure. Non-local means model
repeated structure, but leave ripples of the blur beside single edges. The half-quadratic splitting
uses both. w is the shrunk gradients; their weight rho rises from stage to stage. v is s f, denoised
for noise of standard deviation t; t falls from stage to stage, and the weight of v is alpha / t^2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deshake.signal.non_local_means import non_local_means

if TYPE_CHECKING:
    from deshake.run import Run
    from deshake.signal.half_quadratic import HalfQuadratic

__all__ = ["plug_and_play"]

_RHO = (0.03, 1.0)  # rho of `half_quadratic` in the first and in the last stage
_NOISE = (5.0, 0.7)  # t in the first and in the last stage, in standard deviations of the noise
_ALPHA = 0.35  # alpha: weight of v at t = 1


def plug_and_play(descent: HalfQuadratic, *, stages: int, run: Run) -> None:
    """Improve an estimate of the sharp photo.

    Parameters
    ----------
    descent : HalfQuadratic
        The estimate; it is changed.
    stages : int
        Number of stages, >= 1.
    run : Run
        Receives the progress.

    """
    rhos, noises = (np.geomspace(*ends[::-1], stages)[::-1] for ends in (_RHO, _NOISE))
    for stage, (rho, noise) in enumerate(zip(rhos, noises, strict=True), 1):
        v = non_local_means(descent.f * descent.s, float(noise), run=descent.run)
        descent.step(float(rho), _ALPHA / float(noise) ** 2, v)
        run.report(stage / stages, f"deblurring finely, stage {stage}")
