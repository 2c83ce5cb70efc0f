"""The constants of kernels from the whole frame: wide starts, and the growth of wide kernels."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FrameWay", "GrowthSettings", "WideStartSettings", "WideWay"]


@dataclass(frozen=True)
class WideWay:
    """One start of a very wide shake.

    Parameters
    ----------
    side : int
        Px: shorter side of the frame at the last scale, about.
    reach : int
        Px of the last scale: the kernel's room, from its centre.
    first, last : float
        Squared contrast: price of an edge in the first iteration, and in the last one.
    iterations : int
        Iterations at each scale.
    cut : float
        Share of the kernel's largest value: smaller ones are noise.
    faint : float
        Share of the kernel's light: the smallest values that hold less are noise.

    """

    side: int
    reach: int
    first: float
    last: float
    iterations: int = 5
    cut: float = 0.05
    faint: float = 0.0


@dataclass(frozen=True)
class FrameWay:
    """One refinement of a wide kernel on the whole frame.

    Parameters
    ----------
    first, last : int
        The first scale and the last one, counted from the scale of the kernel; coarser is more.
    room : float
        Room of the kernel at the first scale, as a factor of its own reach.
    dear, cheap : float
        Squared contrast: price of an edge in the first iteration, and in the last one.
    iterations : int
        Iterations at each scale.
    faint : float
        Share of the kernel's light: the smallest values that hold less are noise. A camera that
        rests and then goes far leaves a faint tail, which the limit of the starts cuts off.
    pixels : float
        Largest number of pixels of the frame at the last scale.

    """

    first: int
    last: int
    room: float
    dear: float
    cheap: float
    iterations: int
    faint: float = 0.3
    pixels: float = 0.25e6


@dataclass(frozen=True)
class WideStartSettings:
    """Kernels of very wide shakes (`wide_start`).

    72 ways were tried on three real photos shaken by a tenth of the frame. Which of them run, and
    what is noise, was chosen on 13 real photos.

    Parameters
    ----------
    ways : tuple of WideWay
        The starts. In small photos the finest scales are missing.
    least_reach : float
        Px: reach of the kernel's room at the first scale, about.
    contrast : float
        Standard deviation of the frame: its picture is scaled to it.
    dark : float
        On the scale of that picture: a darker pixel may be black. It falls to 0.
    patch, least_patch : float, int
        Side of a patch with a dark pixel: over the mean side of the frame, and least px.
    beta_max, growth : float
        Largest weight of the split gradients, and its factor from step to step.
    ridge : float
        Squared contrast: what the least squares of the kernel add to the power of the edges.
    least_piece : float
        Share of the kernel's light: a piece with less is noise.
    spare : int
        Px around a kernel that is refined, at the first scale.

    """

    ways: tuple[WideWay, ...] = (
        WideWay(135, 12, 0.025, 1e-3),
        WideWay(190, 12, 0.025, 1e-3),
        WideWay(270, 20, 0.025, 1e-3),
        WideWay(135, 12, 0.025, 1e-3, iterations=8, cut=0.0, faint=0.3),
        WideWay(135, 12, 0.075, 2.5e-3, iterations=8, cut=0.0, faint=0.3),
        WideWay(190, 20, 0.025, 1e-3, iterations=8, cut=0.0, faint=0.3),
        WideWay(270, 20, 0.025, 1e-3, iterations=8, cut=0.0, faint=0.3),
    )
    least_reach: float = 3.0
    contrast: float = 0.25
    dark: float = 0.1
    patch: float = 0.025
    least_patch: int = 4
    beta_max: float = 1e3
    growth: float = 2.0
    ridge: float = 2.0
    least_piece: float = 0.05
    spare: int = 2


@dataclass(frozen=True)
class GrowthSettings:
    """The growth of wide kernels (`growth`).

    Parameters
    ----------
    least_share : float
        Width of a kernel that grows, as a share of the shorter side of the frame.
    ways : tuple of FrameWay
        How it grows.
    rounds : int
        Largest number of rounds.
    coarser : int
        Scales from that of the kernel to that of the comparison.
    finer : int
        Scales from that of the refinement of a new kernel to the one that suits it.
    vain, wider : float, float
        Score, and factor of the width: if no kernel of the first way scores at most so much less
        and is so much wider, the round ends.
    gain : float
        Score: a kernel that takes the place scores so much more.
    least_match : float
        Share of the match of a kernel that one in its place has, each at its own scale.

    """

    least_share: float = 0.015
    ways: tuple[FrameWay, ...] = (
        FrameWay(2, 1, 2.0, 8e-3, 1e-3, 10),
        FrameWay(2, 0, 2.0, 8e-3, 1e-3, 8),
        FrameWay(1, 0, 2.0, 8e-3, 1e-3, 10),
    )
    rounds: int = 2
    coarser: int = 3
    finer: int = 1
    vain: float = 0.1
    wider: float = 1.2
    gain: float = 0.01
    least_match: float = 0.4
