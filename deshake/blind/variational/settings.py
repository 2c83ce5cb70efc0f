"""The constants of the variational estimate (`estimate`, `scales`, `coarse_to_fine`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["SETTINGS", "VariationalSettings"]


@dataclass(frozen=True)
class VariationalSettings:
    """Sizes and thresholds of the estimate; the priors are in `priors`.

    No record says what the values were tuned on. `figure6.py --estimators variational` measures
    them together.

    Parameters
    ----------
    longest_side : int
        Px: longer side of the finest scale; larger photos are reduced to it.
    smallest_side : int
        Px: least side of the coarsest scale; a small photo has fewer scales.
    coarsest_blur : float
        Px: width of the blur at the coarsest scale.
    enough_blur : float
        Px: width of the blur; if it is reached, no finer scale is solved.
    contrast : float
        Rms gradient of the scaled photo, on 0..256, reduced to `contrast_side`: the
        contrast that the priors are made for.
    contrast_side : int
        Px: longer side of the picture that measures the contrast.
    least_contrast : float
        The same gradient of the photo itself: less is an error.
    fine_blur : float
        Px: bound of the blur; up to it only noise causes smoothing.
    smoothing : float
        Px of sigma for each px of the bound above that.
    smoothing_noise : float
        Px of sigma for noise of 1 on 0..256, in the contrast of the priors.
    most_smoothing : float
        Px: largest sigma, however wide the blur and strong the noise.
    trial_side : int
        Px: longer side of the last scale that may reject a bound as too small.
    touching : float
        Share of the weight on the faces of the box: above it, the box is too small.
    close : float
        The same share at a coarse scale, where a larger bound costs little: above it, a
        larger bound is tried.
    least_observed : float
        Share of the pixels that must be usable: less is an error.
    iterations : int
        Iterations at each scale; the first one has two more.
    cut : float
        Share of the largest weight: smaller ones are removed between scales and at the end.
    prune : float
        Share of the largest weight: smaller ones are removed within a scale.
    prune_gain : float
        Share of the rotations: if at least as many would stay, none is removed within a
        scale.
    hops : tuple of int
        Px: distance of the patches at the finest scale, and at the coarser ones.
    still_px : float
        Px at the finest scale: a smaller extent is no shake.

    """

    longest_side: int = 640
    smallest_side: int = 16
    coarsest_blur: float = 3.0
    enough_blur: float = 22.0
    contrast: float = 30.0
    contrast_side: int = 100
    least_contrast: float = 0.02
    fine_blur: float = 12.0
    smoothing: float = 0.06
    smoothing_noise: float = 0.13
    most_smoothing: float = 1.0
    trial_side: int = 200
    touching: float = 0.02
    close: float = 0.005
    least_observed: float = 0.05
    iterations: int = 12
    cut: float = 0.05
    prune: float = 0.004
    prune_gain: float = 0.85
    hops: tuple[int, ...] = (32, 16)
    still_px: float = 1.5


SETTINGS: Final = VariationalSettings()
