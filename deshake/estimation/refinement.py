"""A kernel refined at a higher resolution than it was found at, where that pays.

What finds a kernel, few edges and sharpened ones, is not what is truest to it: once it is about
right, more edges tell more, as they are and at the photo's finer scales. But the latent pictures of
a kernel that is not right draw it on to a point. So each step is only tried, and the judge, who
sees more at 640 px than at the size that it chooses at, takes the kernel before or after it.
Photos that have no more pixels than kernels are found at lose by it, and are passed over.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deshake.blind.trimming import strongest
from deshake.blind.variational.coarse_to_fine import turned_gradients
from deshake.estimation import judge
from deshake.estimation.candidates import reduced
from deshake.estimation.edge_scale import EdgeScale
from deshake.estimation.edges import EdgeEstimate
from deshake.estimation.latent_edges import contrast_scaled, least_price
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from deshake.geometry.camera import Camera

__all__ = ["STEPS", "RefinementStep", "refined", "refined_once"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_FOUND_AT = 640  # px: smaller photos are not refined
_JUDGE_SIDE = 640  # px
_MOST_LOSS = 0.005  # of energy
_ITERATIONS = 4
_CARRIED = 0.02  # weights that a step begins with, of the largest
_MOST = 300  # rotations that a step begins with, before it is given room
_CUT = 0.03  # weights below this share of the largest are noise
_WIDEST = 60.0  # px: wider kernels are not known well enough for finer scales


class RefinementStep(NamedTuple):
    """The longer side in pixels that a photo is reduced to, and the price of an edge there."""

    side: int
    price: float


STEPS = (RefinementStep(640, 2e-3), RefinementStep(900, 1e-3))
"""What is tried in turn."""


def refined(
    grey: Image,
    found: EdgeEstimate,
    *,
    usable: Mask | None = None,
    axes: tuple[bool, bool, bool] = ALL_AXES,
    steps: Sequence[RefinementStep] = STEPS,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> EdgeEstimate:
    """Refine an estimated kernel as far as the judge finds it the better for it.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, of any size.
    found : EdgeEstimate
        The kernel, for the camera of the photo, and its latent picture.
    usable : (h, w) array of bool, optional
        Pixels to be believed; by default all.
    axes : three bools
        The axes that the camera may turn about.
    steps : sequence of RefinementStep
        What to try.
    threads : int, optional
        Threads to use; by default all processors. The result does not depend on it.
    progress : callable, optional
        Called with the share done, 0..1, and a text.

    Returns
    -------
    EdgeEstimate
        The same object where nothing betters it.

    Raises
    ------
    EstimationError
        If the photo is flat.

    """
    camera = found.kernel.camera
    if max(camera.shape) <= _FOUND_AT or not _is_known_at(_FOUND_AT, found.kernel):
        return found
    seen, smaller, known = reduced(grey, camera, usable, _JUDGE_SIDE)

    def judged(kernel: RotationKernel) -> judge.Score:
        return judge.score(seen, kernel.for_camera(smaller), usable=known, threads=threads)

    still, best = judged(RotationKernel.delta(camera)), judged(found.kernel)
    for done, step in enumerate(steps):
        if progress is not None:
            progress(done / len(steps), f"refinement {done + 1} of {len(steps)}")
        if not _is_known_at(step.side, found.kernel):
            continue
        picture, small, mask = reduced(grey, camera, usable, step.side)
        trial = refined_once(
            picture, found.kernel, small, step.price, usable=mask, axes=axes, threads=threads
        )
        score = judged(trial.kernel)
        if score.energy > best.energy + _MOST_LOSS:
            continue
        if judge.margin(score, still) > judge.margin(best, still):
            found, best = trial, score
    if progress is not None:
        progress(1.0, "kernel refined")
    return found


def _is_known_at(side: int, kernel: RotationKernel) -> bool:
    """Whether a kernel is narrow enough for a longer side of so many pixels."""
    shrink = min(side / max(kernel.camera.shape), 1.0)
    return kernel.extent_px() * shrink <= _WIDEST


def refined_once(
    picture: Image,
    kernel: RotationKernel,
    camera: Camera,
    price: float,
    *,
    usable: Mask | None = None,
    axes: tuple[bool, bool, bool] = ALL_AXES,
    threads: int | None = None,
) -> EdgeEstimate:
    """Estimate latent picture and kernel in turn a few times, from a kernel that is about right.

    Parameters
    ----------
    picture : (h, w) array of float32
        The photo in linear light, at the size to work at.
    kernel : RotationKernel
        The kernel, for the photo at any size.
    camera : Camera
        That of `picture`.
    price : float
        Of an edge, in the contrast of `contrast_scaled`; noise makes it higher.
    usable, axes, threads
        As for `refined`.

    Returns
    -------
    EdgeEstimate
        The kernel for the camera that `kernel` has, centred, and the latent picture.

    Raises
    ------
    EstimationError
        If the photo is flat.

    """
    scaled, contrast = contrast_scaled(picture)
    price = max(price, least_price(scaled))
    finer = kernel.for_camera(camera).resampled(grid_steps(camera), axes).above(_CARRIED)
    finer = strongest(finer, _MOST).dilated(axes)
    scale = EdgeScale(finer, scaled, usable, threads)
    for _ in range(_ITERATIONS):
        finer = scale.refined(finer, scale.strong_edges(finer, price), cut=_CUT)
    finer = finer.above(_CUT)
    gradients = scale.latent_gradients() / np.float32(contrast)
    latent = turned_gradients(gradients, camera, finer.centroid)
    return EdgeEstimate(finer.centred().for_camera(kernel.camera), latent)
