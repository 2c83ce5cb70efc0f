"""Restoration with a known rotation kernel and sparse gradients: the default.

The sharp photo is the f that minimises

    1/2 |sqrt(m) s (A f - g)|^2 + tau sum |s D f|_k^p,    p = 0.7,

where A is the filter flow of the kernel, on a latent image that reaches beyond the frame as far as
the blur does. D takes the differences of neighbours, down and across. |.|_k takes both of them and
all colours together; colour differences count k times as much as light, since edges are weaker in
them. s = 1 / sigma(x) divides by the noise, whose variance grows with the light. Edges have the
same units, which are nearly those of display values, so that dark and bright parts are smoothed
alike. The residual of the first estimate is added to the noise, since no kernel is exact. tau grows
as the root of the number of colours.

Half-quadratic splitting minimises it in a few stages (`half_quadratic`). More follow if the last
one still moves the estimate much. A few iterations of Richardson-Lucy, most of them at half the
size, give the first estimate (`coarse_start`). In its model clipped lights may be brighter than
they look. Where lights clipped, m gives their surroundings less weight, and the scene behind them
is restored separately (`lights`); elsewhere m = 1. At high quality, stages with a denoiser follow
(`plug_and_play`).

The filters of a large photo are rough. If a step of the splitting is short, the blur changes too
much for them, and exact ones take their place.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deshake.operators.patch_inverse import approximate_inverse
from deshake.operators.planes import channels_first
from deshake.operators.shake_blur import blur_filters
from deshake.restore.coarse_start import Iterations, coarse_start
from deshake.restore.lights import behind_lights, trust
from deshake.restore.plug_and_play import plug_and_play
from deshake.restore.restoration import Restoration, check_photo
from deshake.run import Run
from deshake.signal.half_quadratic import HalfQuadratic
from deshake.signal.noise import averaged_over_blur, noise_variance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deshake.geometry.kernel import RotationKernel
    from deshake.restore.quality import Quality

    Image = NDArray[np.float32]

__all__ = ["sparse_gradients"]


class _Level(NamedTuple):
    """Iterations of Richardson-Lucy for the first estimate, and behind lights.

    Then stages without denoiser, more of them if the last one does not settle, and stages with
    denoiser.
    """

    start: Iterations
    behind: int
    stages: int
    more: int
    fine: int


_LEVELS = {
    "fast": _Level(Iterations(6, 1, 3), 2, 3, 0, 0),
    "default": _Level(Iterations(12, 3, 8), 3, 5, 5, 0),
    "high": _Level(Iterations(12, 3, 8), 3, 5, 5, 3),
}
_RHO = (0.02, 1.0)  # rho of `half_quadratic` in the first and in the last stage
_SETTLED = 0.18  # sigma: more stages follow if the last one moved f by more, rms
_LARGE = 1_000_000  # pixels: the filters of a photo with more are rough
# durations over that of a stage, for the progress: first estimate, behind lights, with the denoiser
_START, _BEHIND, _DENOISED = 2, 0.5, 2


def sparse_gradients(
    g: Image,
    kernel: RotationKernel,
    *,
    clipped: NDArray[np.bool_] | None = None,
    quality: Quality = "default",
    iterations: int | None = None,
    run: Run = Run(),
) -> Restoration:
    """Deblur a photo whose rotation kernel is known.

    The result lies in the frame of the blur's centroid: the kernel is centred first.

    Parameters
    ----------
    g : (h, w) or (h, w, C) array of float32
        The blurred photo in linear light, 1 where it clips; values below 0 count as 0.
    kernel : RotationKernel
        The blur, for a camera of the photo's size.
    clipped : (h, w) array of bool, optional
        Clipped pixels. There the light may be stronger than it looks.
    quality : {"fast", "default", "high"}
        Fast has fewer stages; high adds stages with a denoiser.
    iterations : int, optional
        Stages of the splitting after the start, >= 1. By default 3 if fast, else 5, and 5 more if
        the last one moves the estimate by more than 0.18 sigma (rms).
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    Restoration

    Raises
    ------
    ValueError
        If the photo is not finite or does not fit the kernel's camera or the clipped pixels, or
        the iterations are fewer than 1.

    """
    check_photo(g, kernel, clipped, iterations)
    level = _LEVELS[quality]
    stages = iterations or level.stages
    lit = clipped is not None and bool(clipped.any())
    efforts = (_START, _BEHIND * lit, stages, _DENOISED * level.fine)
    starting, behind, splitting, finely = run.parts(efforts)

    planes = channels_first(g)
    kernel = kernel.centred()
    margin = kernel.reach_px()
    make_filters = partial(blur_filters, kernel, margin=margin, channels=len(planes), run=run)
    rough = planes[0].size > _LARGE
    blur = make_filters(rough=rough)
    f = coarse_start(
        g, kernel, blur, margin=margin, clipped=clipped, iterations=level.start, run=starting
    )
    noise = noise_variance(g, margin)
    m = np.broadcast_to(np.float32(1), g.shape[:2])  # takes no memory
    if clipped is not None and lit:
        m = trust(f, blur, clipped, noise)
        behind_lights(f, planes, blur, m, iterations=level.behind, run=behind)
    Af = blur.forward(f)
    s = _precision(planes, Af, m, noise, margin)
    del noise
    descent = HalfQuadratic(f, Af, planes, approximate_inverse(blur), m=m, s=s, run=run)
    rhos = np.geomspace(*_RHO[::-1], stages)[::-1].tolist()
    for stage, rho in enumerate(rhos, 1):
        descent.step(rho)
        if stage == stages and iterations is None and descent.moved > _SETTLED:
            rhos += level.more * [rho]  # the loop goes on with these
        if rough and descent.damped:
            rough, blur = False, make_filters()
            descent.replace_filters(approximate_inverse(blur))
        done = np.interp(stage, (0, stages - 1, len(rhos)), (0, 1 - 1 / stages, 1))
        splitting.report(float(done), f"deblurring, stage {stage}")
    if level.fine:
        plug_and_play(descent, stages=level.fine, run=finely)
    out = np.empty_like(g, np.float32, order="C")
    np.maximum(f[:, margin:-margin, margin:-margin], 0, out=channels_first(out))
    return Restoration(out, len(rhos), descent.residual(clipped))


def _precision(g: Image, Af: Image, m: Image, noise: Image, margin: int) -> Image:
    """Return 1 / sigma of every latent pixel, (H, W), from the variance of the noise, (h, w)."""
    error = np.zeros_like(noise)
    for plane, blurred in zip(g, Af, strict=True):
        error += np.square(plane - blurred)
    error *= m / np.float32(len(Af))
    variance = averaged_over_blur(error, margin)
    variance += noise
    np.sqrt(variance, out=variance)
    np.reciprocal(variance, out=variance)
    return np.pad(variance, margin, mode="edge")
