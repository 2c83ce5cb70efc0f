"""The constants of the registration, for the search, the alignment and the small copies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["SETTINGS", "RegistrationSettings"]


@dataclass(frozen=True)
class RegistrationSettings:
    """Thresholds and sizes of the registration.

    Pixels are those of the small copies. `even_likeness` and `likeness_scale` are fitted to
    simulated pairs, right and wrong. For the other values no record says what they were tuned on.

    Parameters
    ----------
    side : int
        Px: longer side of the small copies that are aligned.
    least_side, most_side : int
        Px: least shorter side of the copies, and most longer side; a smaller or a narrower
        photo is an error.
    clipped : float
        Light: a brighter pixel counts as clipped.
    clipped_share : float
        Share of a small pixel: with more clipped light, it is not used.
    proportions : float
        Relative difference of the aspect ratios of two whole photos; with more, they are no
        pair.
    shadow : float
        Share of the mean light: details in darker parts get less weight.
    least_contrast : float
        Standard deviation of the root of the light: less is an error.
    search : float
        Side of the copies of the search, in sides of the copies that are aligned.
    search_px : two floats
        Px: sigmas of the details that the search compares.
    bent_px : float
        Px: motion of the corners, shifts aside, between two steps about X or Y.
    most_tilts : int
        Steps about X, and about Y, at most; a wider search has wider steps.
    least_overlap : float
        Share of the frame that both photos must cover; shifts with less are not candidates.
    candidates : int
        Candidates of the search that are aligned.
    apart_px : float
        Px: least distance of any two of them.
    smooth_px, slow_px : float
        Px: sigmas before the alignment; finer detail and slower variations are removed.
    iterations : int
        Gauss-Newton steps of an alignment, at most.
    enough_px : float
        Px at the edge of the frame: a shorter step ends the iteration.
    longest_step_px : float
        Px at the edge of the frame: longer steps are shortened to it.
    huber : float
        Sigmas: larger residuals get less weight.
    least_pixels : int
        Shared pixels: with fewer, there is no fit and no likeness.
    fine_px, coarse_px : float
        Px: sigmas of the details that likeness compares.
    blocks : int
        Blocks down and across the frame; each gives a likeness of its own.
    even_likeness : float
        Likeness that gives a confidence of 0.5.
    likeness_scale : float
        Scale of the logistic function of likeness: a larger one makes the confidence change
        more slowly.
    same_scene : float
        Confidence: below it, the photos do not show the same scene, an error.

    """

    side: int = 128
    least_side: int = 32
    most_side: int = 640
    clipped: float = 0.98
    clipped_share: float = 0.01
    proportions: float = 0.005
    shadow: float = 0.05
    least_contrast: float = 0.005
    search: float = 0.75
    search_px: tuple[float, float] = (1.2, 8.0)
    bent_px: float = 2.0
    most_tilts: int = 9
    least_overlap: float = 0.3
    candidates: int = 5
    apart_px: float = 2.5
    smooth_px: float = 2.5
    slow_px: float = 12.0
    iterations: int = 12
    enough_px: float = 0.01
    longest_step_px: float = 2.0
    huber: float = 2.0
    least_pixels: int = 100
    fine_px: float = 0.75
    coarse_px: float = 8.0
    blocks: int = 4
    even_likeness: float = 0.58
    likeness_scale: float = 0.05
    same_scene: float = 0.5


SETTINGS: Final = RegistrationSettings()
