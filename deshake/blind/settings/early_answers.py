"""The constants of the answers that need no kernel, and of the estimate that asks for them."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = [
    "BlurKindSettings",
    "BoundsSettings",
    "EdgeSpreadSettings",
    "EstimateSettings",
    "SharpnessSettings",
    "SpectrumFitSettings",
]


@dataclass(frozen=True)
class BoundsSettings:
    """The smallest photo (`bounds`). No record says how it was chosen.

    Parameters
    ----------
    smallest_photo : int
        Px of the shorter side: less is an error.

    """

    smallest_photo: int = 48


@dataclass(frozen=True)
class EstimateSettings:
    """When an estimate ends early, and when the photo stays as it is (`estimate`).

    Tuned on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    fairly_sharp : float
        Value of `sharpness`: a race may end early only with more. A real shaken photo has 0.68.
    least_usable : float
        Share of the pixels that are not clipped: less is an error.
    even : float
        Confidence: with less, harm is likelier than gain, and the photo stays unchanged.
    doubtful : float
        Confidence: with less a kernel is doubtful, and the user should look at the result. A photo
        with the edges of a sharp one stays unchanged. The photo S60 of the set `test` led to that.
    unchanged : float
        Largest confidence of a kernel that leaves the photo unchanged.
    least_margin : float
        Margin: a kernel with less is at best as good as `most_unlikely` says. No deblurred photo of
        the set `tune` has less. Real photos of very wide shakes have, right and half right ones.
    most_unlikely : float
        Confidence of a kernel whose margin says that a still camera explains the photo better.
    most_filled : float
        Largest confidence of a kernel that fills a disk.
    race_share : float
        Share of the computing time after which the race ends.

    """

    fairly_sharp: float = 0.69
    least_usable: float = 0.05
    even: float = 0.5
    doubtful: float = 0.8
    unchanged: float = 0.1
    least_margin: float = -0.05
    most_unlikely: float = 0.79
    most_filled: float = 0.9
    race_share: float = 0.95


@dataclass(frozen=True)
class SharpnessSettings:
    """The steepest edges of a photo (`sharpness`).

    `sharp` is tuned on simulated photos: of 43 shakes of 3 px and more, none exceeds all three
    values; 5 of 10 sharp photos do. The kernel identifies the others. For the other values no
    record says what they were tuned on.

    Parameters
    ----------
    strongest : float
        Quantile of the differences that is the steepness.
    of_noise : float
        That quantile between two pixels of unit noise; it follows from `strongest`.
    tile : int
        Px of the scale: side of a tile.
    tiles : int
        Largest number of tiles.
    blur : float
        Px of the scale: width of the blur for the choice of tiles.
    sharp : (float, float, float)
        Least sharpness of a sharp photo at the three finest scales, no unit.
    flat : float
        Difference of display values, 0..1: a flat photo has less.

    """

    strongest: float = 0.99
    of_noise: float = 2.576 * math.sqrt(2)
    tile: int = 128
    tiles: int = 16
    blur: float = 3.0
    sharp: tuple[float, float, float] = (0.72, 0.65, 0.6)
    flat: float = 1e-6


@dataclass(frozen=True)
class EdgeSpreadSettings:
    """The spread of the sharper edges (`edge_spread`).

    Tuned for the kind of the blur, on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    fine, coarse : float
        Px: standard deviations of the two Gaussians.
    tile : int
        Px: side of a tile.
    tiles : int
        Largest number of tiles.
    whole : float
        Pixels of all tiles: a photo with at most this many times as many is measured whole.
    longest_edges : float
        Px: width of the blur for the choice of tiles.
    straight : float
        Coherence of the gradients around an edge, 0..1: less is no edge.
    around : int
        Px: side of the window for the coherence.
    clear : int
        Px: side of the window around an edge that has no clipped pixel.
    above_noise : float
        Standard deviations of the slopes' noise: a weaker edge does not count.
    least_slope : float
        Display values a pixel: the same in a photo without noise.
    directions : int
        Directions in half a turn.
    sharper : float
        Quantile of the edges of a direction that gives its spread.
    fewest : int
        Edges of a direction; with fewer it does not count.
    most : int
        Edges of a direction; more do not raise its weight.
    ratios : (float, float)
        Squared ratios of the slopes that are resolved; the Gaussians alone have 0.25.

    """

    fine: float = 1.0
    coarse: float = 2.0
    tile: int = 128
    tiles: int = 24
    whole: float = 1.3
    longest_edges: float = 8.0
    straight: float = 0.9
    around: int = 9
    clear: int = 7
    above_noise: float = 6.0
    least_slope: float = 0.004
    directions: int = 12
    sharper: float = 0.3
    fewest: int = 12
    most: int = 200
    ratios: tuple[float, float] = (0.05, 0.93)


@dataclass(frozen=True)
class SpectrumFitSettings:
    """The blur that depends on the direction (`spectrum_fit`).

    Tuned for the kind of the blur, on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    tile : int
        Px of the scale: side of a tile.
    tiles : int
        Largest number of tiles at a scale.
    overlap : float
        Tiles per length of a tile's side, where tiles cover the frame.
    longest_edges : float
        Px of the scale: width of the blur for the choice of tiles.
    band : (float, float)
        Cycles per pixel of the scale: frequencies of the fit.
    most_clipped : float
        Share of a tile's pixels: with more it does not count. Clipped lights have spectra of
        their own.
    least_power : float
        Least share of the power that remains when the noise is subtracted.
    enough_tiles : int
        Fewer tiles make a fit less certain.
    narrowest : float
        Px of the photo: a narrower blur is no shake.
    resolved : float
        Squared px of the scale: least variance along the blur.
    wider : float
        Squared px of the scale: mean variance over the directions. A blur far wider than a pixel
        changes the power law itself; the fit then gives a variance below this one, and the scale
        is too fine.

    """

    tile: int = 64
    tiles: int = 48
    overlap: float = 1.5
    longest_edges: float = 8.0
    band: tuple[float, float] = (0.04, 0.3)
    most_clipped: float = 0.02
    least_power: float = 0.1
    enough_tiles: int = 8
    narrowest: float = 1.0
    resolved: float = 0.15
    wider: float = -0.25


@dataclass(frozen=True)
class BlurKindSettings:
    """The verdict on the kind of the blur (`blur_kind`).

    Tuned on the 63 cases `tune` of `bench.py shakes`.

    Parameters
    ----------
    shaken, perhaps : float
        Evidence of a shake, no unit. With at least `shaken` a photo is shaken, with at least
        `perhaps` it is perhaps shaken.
    edges_worth : float
        Evidence per unit by which the ratio of the edges' two spreads is below `round_edges`.
    round_edges : float
        Ratio of the shorter spread to the longer one; rounder edges give no evidence.
    spread : float
        Px of the photo. Edges whose longer spread is smaller give no evidence.
    out_of_focus, soft : float
        Px of the photo: least longer spread of the edges of a photo out of focus, and of a soft
        one.
    sharp : float
        Sharpness at the finest scale: a photo with more is perhaps sharp, unless it is shaken.
    sharp_at_half, less_evidence : float
        Sharpness at half the size. A photo with more has a narrow blur, if any; so it has less
        evidence of a shake.
    little, little_if_fine : float
        Evidence of a shake: a photo with less is hardly shaken; the second one if the longer spread
        of its edges is below `spread`. Tuned on the first kernels of the photos of `tune`, and of
        scenes in no set.
    path : float
        Extent of a hand's path over the standard deviation of the blur along it.
    quarters : int
        Least number of clearly shaken quarters in a photo that is perhaps shaken.
    quarters_pixels : float
        Largest number of pixels of a photo whose quarters are judged; a larger one is reduced.

    """

    shaken: float = 0.27
    perhaps: float = 0.18
    edges_worth: float = 0.5
    round_edges: float = 0.75
    spread: float = 1.2
    out_of_focus: float = 1.45
    soft: float = 0.55
    sharp: float = 0.615
    sharp_at_half: float = 0.7
    less_evidence: float = 0.1
    little: float = 0.2
    little_if_fine: float = 0.4
    path: float = math.sqrt(12)
    quarters: int = 2
    quarters_pixels: float = 3e6
