"""The blind estimate by name: variational, by edges, or whichever explains the photo best."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from deshake.blind.bounds import check_size
from deshake.blind.kernel_faults import FILLED, SCATTERED, faults
from deshake.blind.result import BlindEstimate
from deshake.blind.variational.estimate import estimate_variational
from deshake.errors import EstimationError
from deshake.estimation.candidates import (
    STILL,
    choose,
    edge_candidates,
    is_at_rest,
    is_soft,
    telling,
)
from deshake.estimation.edges import EdgeEstimate
from deshake.estimation.judge import margin
from deshake.estimation.refinement import refined
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import ALL_AXES, RotationKernel
from deshake.geometry.rotations import grid_steps

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

__all__ = [
    "Estimator",
    "best_estimate",
    "estimate_candidates",
    "estimate_kernel",
    "refined_estimate",
]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

Region = tuple[int, int, int, int]

Estimator = Literal["auto", "edges", "variational"]

_DOUBTFUL = 0.5  # confidence below which the user is told
_HOPELESS = 0.1  # confidence below which the photo is better left as it is
_COARSE = 1.5  # pixels of the photo in a step of a kernel, above which the user is told
_UNSEEN = 2  # steps: the extent of kernels that are mere points
_EDGES_SHARE = 0.5  # of the time, where both estimators run
_REFINED_FROM = 0.8  # of the time
_JUDGED_AT = 0.98  # of the time until then


def estimate_kernel(
    grey: Image,
    camera: Camera,
    *,
    estimator: Estimator = "auto",
    clipped: Mask | None = None,
    blur_px: float | None = None,
    region: Region | None = None,
    uniform: bool = False,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> BlindEstimate:
    """Estimate the blur kernel of one photo, and tell how far to trust it.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 0..1.
    camera : Camera
        Its camera.
    estimator : {"auto", "edges", "variational"}
        The paper's variational inference (Sec. 5), sharp edges with several settings, or both;
        the judge takes the kernel that explains the photo best. Unless the paper's inference is
        asked for, or uniform blur, it is refined then.
    clipped, blur_px, region, uniform, threads, progress
        As for `estimate_variational`.

    Returns
    -------
    BlindEstimate
        Its confidence is the judge's: the chance that deblurring betters the photo. Where there is
        hardly one, where a doubtful kernel is scattered like noise, too, and where the photo looks
        sharp or merely soft, the kernel is that of a camera that stood still, which leaves the
        photo as it is: the notes say so, and the confidence is 0.1 at most.

    Raises
    ------
    EstimationError
        If the photo is too small, too flat or too much clipped.

    """
    tell = progress or (lambda _share, _text: None)
    end = 1.0 if estimator == "variational" else _REFINED_FROM
    candidates = estimate_candidates(
        grey,
        camera,
        estimator=estimator,
        clipped=clipped,
        blur_px=blur_px,
        region=region,
        uniform=uniform,
        threads=threads,
        progress=lambda share, text: tell(end * _JUDGED_AT * share, text),
    )
    found = best_estimate(grey, candidates, clipped=clipped, region=region, threads=threads)
    if estimator != "variational":
        found = refined_estimate(
            grey,
            found,
            clipped=clipped,
            region=region,
            threads=threads,
            progress=lambda share, text: tell(end + (1 - end) * share, text),
        )
    tell(1.0, "kernel estimated")
    return found


def estimate_candidates(
    grey: Image,
    camera: Camera,
    *,
    estimator: Estimator = "auto",
    clipped: Mask | None = None,
    blur_px: float | None = None,
    region: Region | None = None,
    uniform: bool = False,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> dict[str, BlindEstimate]:
    """Estimate the kernels that `estimate_kernel` chooses from, by name; at least one.

    Parameters and errors are those of `estimate_kernel`. Estimates by edges have no confidence of
    their own.
    """
    (x, y, w, h), picture, usable = _within(region, grey, clipped)
    check_size(h, w, 1.0 if blur_px is None else blur_px)
    whole = Camera.uniform(*grey.shape) if uniform else camera
    tell = progress or (lambda _share, _text: None)
    share = {"auto": _EDGES_SHARE, "edges": 1.0, "variational": 0.0}[estimator]
    candidates: dict[str, BlindEstimate] = {}
    if estimator != "variational":
        by_edges = edge_candidates(
            picture,
            whole.cropped(x, y, w, h),
            usable=usable,
            blur_px=blur_px,
            axes=(True, True, False) if uniform else ALL_AXES,
            threads=threads,
            progress=lambda done, text: tell(share * done, text),
        )
        for name, found in by_edges.items():
            kernel = found.kernel.for_camera(whole)
            notes = faults(found.kernel, blur_px=blur_px)
            candidates[name] = BlindEstimate(kernel, 0.0, notes, [], found.latent, name)
    if estimator != "edges":
        try:
            inferred = estimate_variational(
                grey,
                camera,
                clipped=clipped,
                blur_px=blur_px,
                region=region,
                uniform=uniform,
                threads=threads,
                progress=lambda done, text: tell(share + (1 - share) * done, text),
            )
        except EstimationError:
            if not candidates:
                raise
        else:
            seen = inferred.kernel.for_camera(inferred.kernel.camera.cropped(x, y, w, h))
            notes = inferred.notes or faults(seen, blur_px=max(w, h))
            candidates[inferred.name] = replace(inferred, notes=notes)
    return candidates


def best_estimate(
    grey: Image,
    candidates: Mapping[str, BlindEstimate],
    *,
    clipped: Mask | None = None,
    region: Region | None = None,
    threads: int | None = None,
) -> BlindEstimate:
    """Take the candidate that explains the photo best, with the judge's confidence.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 0..1.
    candidates : mapping
        What `estimate_candidates` found.
    clipped, region, threads
        As for `estimate_kernel`.

    """
    box, picture, usable = _within(region, grey, clipped)
    kernels = {
        name: found.kernel.for_camera(found.kernel.camera.cropped(*box))
        for name, found in candidates.items()
    }
    choice = choose(picture, kernels, usable=usable, threads=threads)
    found = candidates[choice.name]
    if is_at_rest(picture, kernels):
        note = f"{_no_shake(kernels.values())}, the photo looks sharp: it is left as it is"
        return _left(found, min(choice.confidence, _HOPELESS), note)
    scattered = choice.confidence < _DOUBTFUL and SCATTERED in found.notes
    if choice.confidence < _HOPELESS or scattered:
        note = (
            f"no kernel was found that betters the photo, the best is doubtful ({choice.name}, "
            f"confidence {choice.confidence:.2f}): the photo is left as it is"
        )
        return _left(found, min(choice.confidence, _HOPELESS), note)
    calm = max(telling(kernels), key=lambda name: margin(choice.scores[name], choice.scores[STILL]))
    if is_soft(picture, kernels[calm]):
        note = "the photo is a little soft rather than shaken: it is left as it is"
        return _left(found, min(choice.confidence, _HOPELESS), note)
    notes = list(found.notes)
    asked = telling(candidates)
    filled = sum(FILLED in candidate.notes for candidate in asked.values())
    if 2 * filled >= len(asked) and FILLED not in notes:
        notes.append(FILLED)
    if choice.confidence < _DOUBTFUL:
        notes.append(
            f"the kernel is doubtful (confidence {choice.confidence:.2f}): "
            "compare the result with the photo"
        )
    return replace(found, confidence=choice.confidence, notes=notes)


def refined_estimate(
    grey: Image,
    found: BlindEstimate,
    *,
    clipped: Mask | None = None,
    region: Region | None = None,
    threads: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> BlindEstimate:
    """Refine what was found at a higher resolution; the same where that betters nothing.

    Uniform kernels are left, too: they are finished where they are found.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 0..1.
    found : BlindEstimate
        What `best_estimate` took; its confidence and notes stay.
    clipped, region, threads, progress
        As for `estimate_kernel`.

    """
    whole = found.kernel.camera
    if whole.is_uniform or found.name == STILL:
        return found
    box, picture, usable = _within(region, grey, clipped)
    rough = EdgeEstimate(found.kernel.for_camera(whole.cropped(*box)), found.latent)
    fine = refined(picture, rough, usable=usable, threads=threads, progress=progress)
    if fine is rough:
        return found
    return replace(found, kernel=fine.kernel.for_camera(whole), latent=fine.latent)


def _within(
    region: Region | None, grey: Image, clipped: Mask | None
) -> tuple[Region, Image, Mask | None]:
    """Return a region, by default all of the photo, what it shows, and what is to be believed."""
    height, width = grey.shape
    x, y, w, h = box = (0, 0, width, height) if region is None else region
    part = np.s_[y : y + h, x : x + w]
    return box, grey[part], None if clipped is None else ~clipped[part]


def _no_shake(kernels: Iterable[RotationKernel]) -> str:
    """Say that no shake was found, and how wide one might be that was too small to be seen."""
    # in pixels of the photo, that of the finest
    step = min(float((kernel.steps / grid_steps(kernel.camera)).max()) for kernel in kernels)
    wider = f" wider than about {_UNSEEN * step:.0f} pixels" if step > _COARSE else ""
    return f"no shake{wider} was found"


def _left(found: BlindEstimate, confidence: float, note: str) -> BlindEstimate:
    """Leave the photo as it is: the kernel of a camera that stood still."""
    kernel = RotationKernel.delta(found.kernel.camera, steps=found.kernel.steps)
    return replace(found, kernel=kernel, confidence=confidence, notes=[note], name=STILL)
