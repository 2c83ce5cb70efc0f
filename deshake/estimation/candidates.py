"""Candidate kernels of one photo, and the choice between them.

No one setting of the estimate by edges suits all photos: kernels are estimated with each of
several, and a judge that knows nothing of the truth takes the best. The camera that stood still
is always among the candidates, and tells how far the choice is to be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from deshake.blind.kernel_faults import is_point, spread_px
from deshake.estimation import judge
from deshake.estimation.edge_settings import EAGER
from deshake.estimation.edges import SETTINGS, EdgeEstimate, EdgeSetting, estimate_edges
from deshake.estimation.sharpness import looks_sharp, looks_soft
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

__all__ = [
    "JUDGE_SIDE",
    "STILL",
    "Choice",
    "choose",
    "edge_candidates",
    "is_at_rest",
    "is_soft",
    "reduced",
    "telling",
]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
T = TypeVar("T")

JUDGE_SIDE = 400
"""Longer side in pixels that photos are reduced to for the judge."""

STILL = "still"
"""Name of the camera that stood still among the scores."""

_SHARP_SIDE = 640  # px, that photos are reduced to before they are called sharp
_HANDICAP = 0.01
"""Of kernels that are hardly more than a point, in the margin: they sharpen any photo a little."""


@dataclass(frozen=True, eq=False)
class Choice:
    """The kernel that was chosen.

    Parameters
    ----------
    name : str
        Its name among the candidates.
    kernel : RotationKernel
        For the camera of the photo.
    confidence : float
        Chance, 0..1, that deblurring with it makes the photo better; below a half it is better
        left alone.
    scores : dict
        Of all candidates, by name, and of the camera that stood still.

    """

    name: str
    kernel: RotationKernel
    confidence: float
    scores: dict[str, judge.Score]


def reduced(
    grey: Image, camera: Camera, usable: Mask | None, side: int
) -> tuple[Image, Camera, Mask | None]:
    """Reduce a photo (h, w), its camera and its mask to a longer side of `side` pixels or less."""
    shrink = side / max(grey.shape)
    if shrink >= 1:
        return grey, camera, usable
    smaller = camera.scaled(*(max(round(n * shrink), 1) for n in grey.shape))
    size = smaller.width, smaller.height
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    if usable is None:
        return small, smaller, None
    part = cv2.resize(usable.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return small, smaller, np.asarray(part > 1 - 1e-3)


def edge_candidates(
    grey: Image,
    camera: Camera,
    *,
    usable: Mask | None = None,
    blur_px: float | None = None,
    axes: tuple[bool, bool, bool] = ALL_AXES,
    settings: Sequence[EdgeSetting] = SETTINGS,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> dict[str, EdgeEstimate]:
    """Estimate a kernel with each of several settings.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, of any size.
    camera : Camera
        Its camera.
    usable : (h, w) array of bool, optional
        Pixels to be believed; by default all.
    blur_px : float, optional
        Bound of the blur in pixels of the photo.
    axes : three bools
        The axes that the camera may turn about.
    settings : sequence of EdgeSetting
        What to try. Where the camera may not roll anyway, those that differ in nothing else are
        tried once.
    threads : int, optional
        Threads to use; by default all processors.
    progress : callable, optional
        Called with the share done, 0..1, and a text.

    Returns
    -------
    dict
        The estimates by the settings' names; the kernels are for `camera`, centred, those of
        uniform settings to within half a step.

    Raises
    ------
    EstimationError
        If the photo is flat.

    """
    rolls = axes[2] and not camera.is_uniform
    # the first of those that come to the same
    distinct = {
        replace(
            one,
            name="",
            roll=one.roll and rolls and not one.uniform,
            uniform=one.uniform and not camera.is_uniform,
        ): one
        for one in reversed(settings)
    }
    tried = [setting for setting in settings if setting in distinct.values()]
    estimates: dict[str, EdgeEstimate] = {}
    for done, setting in enumerate(tried):

        def advance(share: float, text: str, done: int = done) -> None:
            if progress is not None:
                progress((done + share) / len(tried), f"try {done + 1}, {text}")

        picture, smaller, known = reduced(grey, camera, usable, setting.side)
        bound = None if blur_px is None else blur_px * smaller.width / camera.width
        found = estimate_edges(
            picture,
            Camera.uniform(*smaller.shape) if setting.uniform else smaller,
            usable=known,
            blur_px=bound,
            axes=(axes[0], axes[1], axes[2] and setting.roll),
            setting=setting,
            threads=threads,
            progress=advance,
        )
        kernel = _turned(found.kernel, smaller) if setting.uniform else found.kernel
        estimates[setting.name] = replace(found, kernel=kernel.for_camera(camera))
    return estimates


def _turned(kernel: RotationKernel, camera: Camera) -> RotationKernel:
    """Take the translations of the uniform model for rotations of a camera.

    A turn by theta moves the middle of the frame by ``f theta``, and what is x beside it by
    ``(f + x^2 / f) theta``: on the mean of the frame it moves as far as the translation.
    """
    if camera.is_uniform:
        return kernel
    f = camera.focal_px
    moved = f + np.array([camera.height, camera.width, 0]) ** 2 / (12 * f)
    scale = kernel.camera.focal_px / moved
    steps = kernel.steps * scale
    steps[2] = grid_steps(camera)[2]
    return RotationKernel(kernel.theta * scale, kernel.weights, steps, camera)


def choose(
    grey: Image,
    kernels: Mapping[str, RotationKernel],
    *,
    usable: Mask | None = None,
    threads: int | None = None,
) -> Choice:
    """Choose the kernel that the judge finds best, if need be rather no mere point.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, of any size.
    kernels : mapping
        The candidates by name, at least one, all for one camera, that of the photo.
    usable : (h, w) array of bool, optional
        Pixels to be believed; by default all.
    threads : int, optional
        Threads to use; by default all processors.

    Raises
    ------
    EstimationError
        If the photo is flat.
    ValueError
        If there is no candidate.

    """
    if not kernels:
        msg = "there is no kernel to choose"
        raise ValueError(msg)
    camera = next(iter(kernels.values())).camera
    picture, smaller, known = reduced(grey, camera, usable, JUDGE_SIDE)
    trials = {STILL: RotationKernel.delta(camera), **kernels}
    scores = {
        name: judge.score(picture, kernel.for_camera(smaller), usable=known, threads=threads)
        for name, kernel in trials.items()
    }
    still = scores.pop(STILL)
    margins = {
        name: judge.margin(found, still) - _HANDICAP * is_point(kernels[name])
        for name, found in scores.items()
    }
    best = max(margins, key=lambda name: margins[name])
    confidence = judge.confidence(scores[best], still)
    return Choice(best, kernels[best], confidence, {STILL: still, **scores})


def is_at_rest(grey: Image, kernels: Mapping[str, RotationKernel]) -> bool:
    """Tell whether a photo (h, w) was not shaken: it looks sharp, and kernels are mere points.

    Kernels alone are no proof, they collapse on shaken photos, too; sharpness alone is only where
    there is no doubt of it. Kernels of `EAGER` settings are not asked.
    """
    asked = telling(kernels)
    points = sum(is_point(kernel) for kernel in asked.values())
    camera = next(iter(kernels.values())).camera
    seen = reduced(grey, camera, None, _SHARP_SIDE)[0]
    return looks_sharp(seen, collapsed=points / len(asked))


def telling(found: Mapping[str, T]) -> Mapping[str, T]:
    """Leave out what `EAGER` settings found, if anything is left then."""
    return {name: one for name, one in found.items() if name not in EAGER} or found


def is_soft(grey: Image, kernel: RotationKernel) -> bool:
    """Tell whether a photo (h, w) is soft rather than shaken, by the best of its telling kernels.

    The kernel is measured in the photo's own pixels: wide blur may be little at a smaller size.
    """
    seen = reduced(grey, kernel.camera, None, _SHARP_SIDE)[0]
    return looks_soft(seen, spread_px(kernel))
