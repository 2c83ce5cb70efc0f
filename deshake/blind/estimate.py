"""The blind estimate: a kernel for one photo, its confidence, and notes for the user.

The cheapest test comes first. A photo that is sharp to the pixel needs no estimate. If small lights
draw the path of the camera, nothing else is asked. A photo needs no full race if the finest starts
end in a small round spot. A least confidence that the user gives replaces all of these tests but
the streaks: the race goes on to its end, whatever the photo looks like.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from deshake.blind.blur_kind import measured
from deshake.blind.bounds import check_size
from deshake.blind.camera_path import filled_path
from deshake.blind.drawn_path import drawing
from deshake.blind.kernel_faults import FILLED, SCATTERED, faults
from deshake.blind.latent_picture import latent_gradients
from deshake.blind.race import race
from deshake.blind.result import BlindEstimate
from deshake.blind.settings import SETTINGS
from deshake.blind.sharpness import looks_sharp
from deshake.blind.soft_scene import without_softness
from deshake.blind.spot import is_spot
from deshake.blind.trust import confidence, drawn_confidence, two_digits
from deshake.blind.variational.estimate import estimate_variational
from deshake.errors import EstimationError
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.run import Run
from deshake.signal.pyramid import LightBefore, Pyramid

if TYPE_CHECKING:
    from deshake.blind.drawn_path import Drawing
    from deshake.blind.finish import Finish

__all__ = ["STILL", "Estimator", "Region", "estimate_kernel"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Region = tuple[int, int, int, int]
Estimator = Literal["edges", "variational"]

STILL = "still"
"""Name of the estimate that leaves the photo unchanged."""

STREAKS = "the streaks of lights"
"""Name of the estimate that the streaks of lights draw."""

SHARP = "the photo looks sharp: it is left as it is"
SOFT = "the photo is a little soft rather than shaken: it is left as it is"

_S: Final = SETTINGS.estimate


def estimate_kernel(
    grey: Image,
    camera: Camera,
    *,
    estimator: Estimator = "edges",
    clipped: Mask | None = None,
    blur_px: float | None = None,
    region: Region | None = None,
    least_confidence: float | None = None,
    uniform: bool = False,
    quick: bool = False,
    any_focal: bool = False,
    before_curve: LightBefore | None = None,
    run: Run = Run(),
) -> BlindEstimate:
    """Estimate the blur kernel of one photo and its confidence.

    Parameters
    ----------
    grey : (h, w) array of float32
        The photo in linear light, 0..1.
    camera : Camera
        Its camera.
    estimator : {"edges", "variational"}
        "edges" uses sharp edges of tiles at the scale that suits the shake. "variational" is the
        paper's variational inference (Sec. 5) on the whole frame.
    clipped : (h, w) array of bool, optional
        Clipped pixels. The estimate ignores them.
    blur_px : float, optional
        Bound of the blur in pixels of the photo.
    region : (x, y, width, height), optional
        The part of the photo that the estimate uses; by default all of it.
    least_confidence : float, optional
        Confidence, 0..1, with which the kernel of "edges" is kept, whatever the photo looks like.
        By default it is 0.5, or 0.8 if the photo has the edges of a sharp one, and photos that look
        sharp or soft are left.
    uniform : bool
        Whether to use the uniform model: theta_Z = 0 and a very long focal length.
    quick : bool
        Whether to return the first good kernel, for a preview.
    any_focal : bool
        Whether the focal length of the camera is only assumed. Then "edges" estimates it, too,
        unless the model is uniform.
    before_curve : callable, optional
        Returns the light before a tone curve of some strength, where a camera may have given the
        photo one. Then "edges" looks at this light, and tries the root of the given one, too.
    run : Run, optional
        Threads to use, and who receives the progress.

    Returns
    -------
    BlindEstimate
        The kernel, its confidence, and notes. If no kernel has the least confidence, or if the
        photo is sharp or only soft, the kernel is that of a still camera. Then a note says so, and
        the confidence is at most 0.1.

    Raises
    ------
    EstimationError
        If the photo is too small, too flat, or nearly all clipped.

    """
    if estimator == "variational":
        return estimate_variational(
            grey,
            camera,
            clipped=clipped,
            blur_px=blur_px,
            region=region,
            uniform=uniform,
            run=run,
        )
    run.report(0.0, "looking at the photo")
    height, width = grey.shape
    x, y, w, h = region or (0, 0, width, height)
    check_size(h, w, 1.0 if blur_px is None else blur_px)
    part = np.s_[y : y + h, x : x + w]
    if clipped is not None and not 1 - clipped[part].mean() > _S.least_usable:
        msg = "nearly all pixels are clipped: there is no detail to estimate the shake from"
        raise EstimationError(msg, hint="name a part with detail: --region X,Y,W,H")
    whole = Camera.uniform(height, width) if uniform else camera
    camera_of_part = whole.cropped(x, y, w, h)
    pyramid = Pyramid(grey[part], camera_of_part, None if clipped is None else clipped[part])
    measures = measured(pyramid)
    judged = least_confidence is None
    if judged and measures.surely_sharp:
        run.report(1.0, "the photo looks sharp")
        return _unchanged(pyramid, whole, _S.unchanged, SHARP)
    drawn = drawing(pyramid, roll=not uniform, bound=blur_px)
    if drawn is not None and drawn_confidence(drawn) >= (least_confidence or 0):
        run.report(1.0, "kernel read from the streaks of lights")
        return _read(pyramid, whole, drawn, blur_px, (x, y))
    may_rest = judged and measures.sharpness > _S.fairly_sharp
    result = race(
        pyramid,
        axes=(True, True, not uniform),
        bound=blur_px,
        quick=quick,
        may_rest=may_rest,
        any_focal=any_focal,
        before_curve=before_curve,
        toned=before_curve is not None and not may_rest,  # sharp drawings would take twice as long
        evidence=measures.certain_evidence if judged else math.inf,
        hardly_shaken=judged and measures.hardly_shaken,
        hopeful=SETTINGS.course.hopeful if judged else 0.0,
        run=run.part(0, _S.race_share),
    )
    estimate = _concluded(pyramid, whole, result, blur_px, least_confidence)
    run.report(1.0, "kernel estimated")
    return estimate


def _read(
    pyramid: Pyramid, whole: Camera, drawn: Drawing, blur_px: float | None, corner: tuple[int, int]
) -> BlindEstimate:
    """Turn the path that the streaks of lights draw into an estimate for the photo."""
    return BlindEstimate(
        drawn.kernel.for_camera(whole),
        drawn_confidence(drawn),
        faults(drawn.kernel, blur_px=blur_px),
        [],
        latent_gradients(pyramid, drawn.kernel),
        STREAKS,
        streaks=drawn.boxes + np.array([*corner, 0, 0]),
    )


def _concluded(
    pyramid: Pyramid,
    whole: Camera,
    result: Finish,
    blur_px: float | None,
    least_confidence: float | None = None,
) -> BlindEstimate:
    """Turn the result of a race into an estimate for the photo."""
    kernel = result.winner.kernel
    trust = confidence(result)
    point = len(kernel.weights) == 1 or not kernel.extent_px() > 1
    if point or result.at_rest or (least_confidence is None and is_spot(kernel)):
        return _unchanged(pyramid, whole, min(trust, _S.unchanged), SHARP if point else SOFT)
    notes = faults(_on_its_grid(kernel), blur_px=blur_px)
    least = _usual_least(pyramid) if least_confidence is None else least_confidence
    if trust < least:
        note = (
            f"no estimate of the shake is sure enough (best confidence {two_digits(trust)}): the "
            "photo is left as it is; --least-confidence 0 deblurs it all the same"
        )
        return _unchanged(pyramid, whole, min(trust, _S.unchanged), note)
    if FILLED in notes and trust < 1:
        trust = min(trust, _S.most_filled)
    if result.margin < _S.least_margin:
        trust = min(trust, _S.most_unlikely)
    if trust < _S.doubtful:
        notes.append(
            f"the estimate of the shake is doubtful (confidence {two_digits(trust)}): compare the "
            "result with the photo"
        )
    elif SCATTERED in notes:  # a fast part of the path may be too faint; the photo speaks for it
        notes.remove(SCATTERED)
    if FILLED not in notes:  # a disk is no path
        kernel = without_softness(result.winner)
    latent = latent_gradients(pyramid.zoomed(result.zoom), kernel)
    final = filled_path(kernel).for_camera(whole.zoomed(result.zoom))
    name, zoom, tones = result.winner.name, result.zoom, result.tones
    return BlindEstimate(final, trust, notes, [], latent, name, zoom, tones)


def _usual_least(pyramid: Pyramid) -> float:
    """Return the confidence from which a kernel deblurs a photo, if the user gives none."""
    return _S.doubtful if looks_sharp(pyramid) else _S.even


def _on_its_grid(kernel: RotationKernel) -> RotationKernel:
    """Move the centroid of a kernel to the origin, as `faults` expects."""
    return replace(kernel, theta=kernel.theta - kernel.centroid)


def _unchanged(pyramid: Pyramid, whole: Camera, trust: float, note: str) -> BlindEstimate:
    """Return the kernel of a still camera, which leaves the photo unchanged."""
    still = RotationKernel.delta(pyramid.camera)
    latent = latent_gradients(pyramid, still)
    kernel = RotationKernel.delta(whole, steps=grid_steps(whole))
    return BlindEstimate(kernel, trust, [note], [], latent, STILL)
