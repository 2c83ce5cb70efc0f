"""The constants of the race: candidates, refinements, and the polish."""

from __future__ import annotations

from dataclasses import dataclass

from deshake.blind.settings.choosing_tiles import Budget
from deshake.blind.settings.wide_kernels import FrameWay

__all__ = [
    "CandidateSettings",
    "CourseSettings",
    "EntrySettings",
    "PolishSettings",
    "RaceSettings",
    "Refinement",
    "Way",
]


@dataclass(frozen=True)
class Way:
    """The way of one candidate: the price of edges, and the part of a kernel to keep.

    Tuned on the set `tune` of `bench.py shakes`: photos of 0.1 to 16 MP, shakes of 3 to 120 px.

    Parameters
    ----------
    first, last : float
        Squared contrast of the pyramid: price of an edge pixel in the first iteration, and after
        `falling` iterations. In between the price falls geometrically. If it is too low, the
        kernel collapses to a point; if it is too high, the kernel widens.
    falling : int
        Number of iterations in which the price falls.
    iterations, shocks : int
        Number of iterations at each scale. The first `shocks` of them use shock-filtered edges.
    cut, carried : float
        Shares of the kernel's weight. The smallest weights that together hold less than this share
        are noise: `cut` after a fit, `carried` at the beginning of a finer scale.
    most, most_grown : int
        Largest number of rotations: `most` at the beginning of a finer scale, before the kernel
        gets room; `most_grown` after growth.
    small : float
        Width in pixels of the scale. A narrower kernel may grow at every scale.
    wide : float
        Width in pixels of the scale. A wider kernel would break into pieces.
    noise : float
        Least price of an edge, in variances of the noise.
    thin : bool
        Whether a kernel is reduced to a thin path before a finer scale, and the price falls to
        `last` within each scale. Otherwise a kernel stays as wide as its estimate. Wide shakes
        often succeed in only one of the two ways.

    """

    first: float = 8e-2
    last: float = 2e-3
    falling: int = 45
    iterations: int = 5
    shocks: int = 3
    cut: float = 0.03
    carried: float = 0.03
    most: int = 150
    most_grown: int = 500
    small: float = 8.0
    wide: float = 41.0
    noise: float = 10.0
    thin: bool = False


@dataclass(frozen=True)
class CandidateSettings:
    """A candidate, in each of two ways (`candidate`).

    Tuned with the ways on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    fine, thin : Way
        The two ways. The starts of a race take them in turn.
    start_half : (int, int, int)
        Grid steps about X, Y and Z: half size of the first cube.
    growth_limit : int
        Ratio of the frame's shorter side to the largest index of a grown kernel.
    least_growth : int
        Grid steps: this index is allowed in the smallest frame, too.
    spare : int
        Grid steps beyond the bound of the blur that a kernel may use.
    light : float
        Share of the kernel's weight: rotations that hold less are discarded.
    faint : float
        Share of the kernel's weight that its width does not count.
    main : float
        Share of a wide kernel's weight: a main piece with less does not replace it.

    """

    fine: Way = Way()
    thin: Way = Way(thin=True)
    start_half: tuple[int, int, int] = (2, 2, 1)
    growth_limit: int = 6
    least_growth: int = 3
    spare: int = 2
    light: float = 1e-4
    faint: float = 0.05
    main: float = 0.8


@dataclass(frozen=True)
class Refinement:
    """How an approximate kernel is refined at one scale.

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    price : float
        Squared contrast of the pyramid: price of an edge pixel.
    iterations : int
        Number of iterations. Each estimates the latent picture and then the kernel.
    carried, cut : float
        Shares of the kernel's weight. The smallest weights that together hold less than this share
        are discarded: `carried` at the beginning, `cut` after a fit.
    most : int
        Largest number of rotations at the beginning, before the kernel gets room.
    room : bool
        Whether the kernel gets room around its rotations.
    budget : Budget
        Number of pixels that the estimate uses.

    """

    price: float
    iterations: int = 8
    carried: float = 0.01
    cut: float = 0.03
    most: int = 160
    room: bool = True
    budget: Budget = Budget(0.25e6, 0.3e6)


@dataclass(frozen=True)
class EntrySettings:
    """A kernel in the race (`entry`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    faint : float
        Share of the kernel's weight that its width does not count.
    roll_worth : float
        Margin: least gain that justifies a kernel with roll.
    least_roll : float
        Grid steps: a kernel that is centred rolls a little, without any meaning.
    least_width : float
        Px of the kernel's scale: a narrower kernel is a point and is not refined.
    agreeing : int
        Number of nearest kernels in the mean agreement.

    """

    faint: float = 0.05
    roll_worth: float = 0.003
    least_roll: float = 0.5
    least_width: float = 2.5
    agreeing: int = 3


@dataclass(frozen=True)
class CourseSettings:
    """The starts of a race, and which of them go on (`course`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    coarsest_start : int
        Index of the coarsest first scale.
    fewest_starts : int
        Number of starts: with fewer, every scale is a first scale.
    wide : int
        Largest number of wide starts in the race.
    wide_share : float
        Share of the match of the best kernel, if it is beyond doubt: wide starts match as much.
    tiny : int
        Px: in photos whose shorter side is at most as long, wide starts always take part.
    least_width : float
        Px of the scale: a wide start is wider. The other starts find narrower kernels better.
    snapshots : int
        Number of last scales of a candidate whose kernels are kept.
    refined, refined_if_sure : int
        Number of starts whose last kernels are refined, and matched to the spectra again; the
        second if the best kernel of the starts is beyond doubt. Wide starts among them push no
        others out: in doubt, as many others are refined.
    polished : int
        Number of starts whose best kernel is polished. It is one if that is beyond doubt, and the
        photo is not tiny.
    hopeful : float
        Confidence: if no start has a kernel with as much, none is refined, and the race ends. Of 34
        photos of the set `tune`, those with less are left as they are after a full race, too; the
        least that ended above even odds has 0.34. Of the real photos, Köhler et al.'s 3_8 has
        0.19, and its second race succeeds.
    refinement, uniform_refinement : Refinement
        How they are refined, and the second way of the uniform model.

    """

    coarsest_start: int = 11
    fewest_starts: int = 4
    wide: int = 3
    wide_share: float = 0.8
    tiny: int = 320
    least_width: float = 10.0
    snapshots: int = 2
    refined: int = 4
    refined_if_sure: int = 3
    polished: int = 2
    hopeful: float = 0.15
    refinement: Refinement = Refinement(2e-3, iterations=5)
    uniform_refinement: Refinement = Refinement(1e-3, iterations=5)


@dataclass(frozen=True)
class RaceSettings:
    """The tones of a race, and its early end (`race`).

    Tuned on the set `tune` of `bench.py shakes` and on real photos, as `docs/estimation.md` says.

    Parameters
    ----------
    of_starts, of_camera : float
        Strengths of a camera's tone curve: the starts run in the light before the first one, and
        the race may go on in that before the second one.
    least_match, least_gain : float
        Match of the spectra, and gain of the margin over the same kernel turned. If the best kernel
        of the two finest starts has less of both, the race of a photo that is hardly shaken ends
        there.
    little_evidence : float
        Evidence of a shake, no unit: with less, the race may end after all starts of edges, and it
        runs in linear light alone.
    vain : float
        Confidence of the best kernel: with less, it ends there.
    display_doubt, match_doubt : float
        Margin, and match: if display values explain a trusted kernel worse by more than one of
        these, no starts of edges run in them.
    display_worth : float
        Margin: least gain of the score of the starts that justifies display values.
    second : float
        Confidence: the kernel of the other tones needs as much, if that of the first is undecided;
        in display values even odds are enough, if they explain the photo better.
        Two attempts succeed by chance more often than one. A real photo (court) has 0.59, a sharp
        drawing (S06) 0.54.

    """

    of_starts: float = 0.5
    of_camera: float = 1.0
    least_match: float = 0.04
    least_gain: float = 0.07
    little_evidence: float = 0.18
    vain: float = 0.2
    display_doubt: float = 0.015
    match_doubt: float = 0.01
    display_worth: float = 0.02
    second: float = 0.57


@dataclass(frozen=True)
class PolishSettings:
    """The last refinements (`polish`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    other_edges : Refinement
        The first kernel of a start once more, with a higher price: from fewer edges.
    thin, smooth : Refinement
        Refinement of a thin path, and of a smooth path.
    frame : tuple of FrameWay
        Refinements of a kernel that is wide for the frame. The prices were chosen on two real
        photos, `postcard` and `las_vegas`, by the likeness to the kernels of PMP's results, and the
        last way on four of Köhler et al.
    last_frame : tuple of FrameWay
        The last refinements of such a kernel. They were chosen out of 80 ways on six photos of
        Köhler et al., by the score of the comparison and by the results.
    rounds : int
        Largest number of rounds; a round that does not raise the score is the last.
    tracings : int
        Largest number of further rounds, in which paths are traced closely.

    """

    other_edges: Refinement = Refinement(1e-2)
    thin: Refinement = Refinement(2e-3, iterations=4, budget=Budget(0.6e6, 0.6e6, 1.2e6))
    smooth: Refinement = Refinement(2e-3, iterations=3, budget=Budget(0.6e6, 0.6e6, 1.2e6))
    frame: tuple[FrameWay, ...] = (
        FrameWay(0, -2, 1.0, 2e-3, 2e-3, 5),
        FrameWay(0, -2, 1.0, 1e-3, 1e-3, 5),
        FrameWay(0, -2, 1.0, 5e-4, 5e-4, 5),
        FrameWay(0, -3, 1.3, 4e-3, 5e-4, 6),
    )
    last_frame: tuple[FrameWay, ...] = (
        FrameWay(0, -2, 1.4, 5e-4, 5e-4, 6),
        FrameWay(1, -3, 1.4, 5e-4, 5e-4, 6, faint=0.4, pixels=0.4e6),
        FrameWay(2, -2, 1.0, 4e-3, 5e-4, 6),
    )
    rounds: int = 4
    tracings: int = 3
