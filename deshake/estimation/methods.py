"""The blind estimate by name: variational, by edges, or whichever explains the photo best."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from deshake.errors import EstimationError
from deshake.estimation.blind import BlindEstimate, check_size, estimate_blind
from deshake.estimation.candidates import choose, edge_candidates
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import ALL_AXES, RotationKernel

if TYPE_CHECKING:
    from collections.abc import Callable

    from deshake.estimation.edges import EdgeEstimate

__all__ = ["Estimator", "estimate_kernel"]

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

Estimator = Literal["auto", "edges", "variational"]

_DOUBTFUL = 0.5  # confidence below which the user is told
_CONVINCING = 0.8  # confidence from which on edges may take the place of inference
_EDGES_SHARE = 0.5  # of the time, where both estimators run


def estimate_kernel(
    grey: Image,
    camera: Camera,
    *,
    estimator: Estimator = "auto",
    clipped: Mask | None = None,
    blur_px: float | None = None,
    region: tuple[int, int, int, int] | None = None,
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
        The paper's variational inference (Sec. 5), sharp edges with several settings, or both:
        the judge then takes the kernel that explains the photo best, and the variational one
        where none convinces it.
    clipped, blur_px, region, uniform, threads, progress
        As for `estimate_blind`.

    Returns
    -------
    BlindEstimate
        Its confidence is the judge's: the chance that deblurring betters the photo.

    Raises
    ------
    EstimationError
        If the photo is too small, too flat or too much clipped.

    """
    height, width = grey.shape
    x, y, w, h = (0, 0, width, height) if region is None else region
    check_size(h, w, 1.0 if blur_px is None else blur_px)
    whole = Camera.uniform(height, width) if uniform else camera
    part = whole.cropped(x, y, w, h)
    picture = grey[y : y + h, x : x + w]
    usable = None if clipped is None else ~clipped[y : y + h, x : x + w]
    tell = progress or (lambda _share, _text: None)
    both = estimator == "auto"
    kernels: dict[str, RotationKernel] = {}
    by_edges: dict[str, EdgeEstimate] = {}
    found: BlindEstimate | None = None
    if estimator != "variational":
        share = _EDGES_SHARE if both else 1.0
        by_edges = edge_candidates(
            picture,
            part,
            usable=usable,
            blur_px=blur_px,
            axes=(True, True, False) if uniform else ALL_AXES,
            threads=threads,
            progress=lambda done, text: tell(0.98 * share * done, text),
        )
        kernels = {name: estimate.kernel for name, estimate in by_edges.items()}
    if estimator != "edges":
        first = _EDGES_SHARE if both else 0.0
        try:
            found = estimate_blind(
                grey,
                camera,
                clipped=clipped,
                blur_px=blur_px,
                region=region,
                uniform=uniform,
                threads=threads,
                progress=lambda done, text: tell(0.98 * (first + (1 - first) * done), text),
            )
        except EstimationError:
            if not kernels:
                raise
        else:
            kernels["variational"] = found.kernel.for_camera(part)
    choice = choose(picture, kernels, usable=usable, threads=threads)
    if both and found is not None and choice.confidence < _CONVINCING:
        # edges that are too faint for their thresholds let kernels collapse; inference does not
        choice = choice.instead("variational", kernels["variational"])
    tell(1.0, "kernel estimated")
    kernel = choice.kernel.for_camera(whole)
    if found is None or choice.name != "variational":
        latent = by_edges[choice.name].latent
        found = BlindEstimate(kernel, choice.confidence, [], [], latent, choice.name)
    notes = list(found.notes)
    if choice.confidence < _DOUBTFUL:
        notes.append(
            f"the kernel is doubtful (confidence {choice.confidence:.2f}): "
            "compare the result with the photo"
        )
    return replace(found, confidence=choice.confidence, notes=notes)
