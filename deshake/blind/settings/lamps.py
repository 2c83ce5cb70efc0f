"""The constants of the estimate by night: the streaks of lamps, and the path that they draw."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["DrawnPathSettings", "StreakFit", "StreakLightSettings", "StreaksSettings"]


@dataclass(frozen=True)
class StreaksSettings:
    """Which bright pieces are streaks, and which streaks agree (`streaks`).

    Tuned on six simulated photos by night (`docs/decisions.md`). Without `dark` and `peak`, texture
    draws paths in 28 of about 120 photos by day, with them in five.

    Parameters
    ----------
    levels : tuple of float
        Light: streaks are pieces that are brighter than this.
    most_pieces : int
        Pieces of a level; more of them are texture.
    least_side, longest_side : int
        Px of the scale: longer side of a streak's box.
    least_area : int
        Px: a smaller piece is no streak.
    dark : float
        Light around a streak, as a share of the level, at most.
    peak : float
        Light of the brightest pixel of a streak, at least.
    dark_part : float
        Share of the surroundings that is so dark.
    ring : int
        Px: width of the surroundings.
    filled : float
        Share of its box that a spot or a surface fills.
    slender : float
        Ratio of the axes of a straight streak, which fills its box, too.
    most : int
        Streaks, at most; more of them tell no more.
    fewest, fewest_long : int
        Streaks that agree, and those of them that show the whole path, at least.
    ridge : float
        Share of the largest distance from the border, nearby: a pixel with more is on the ridge.
    covered : float
        Share of a ridge that lies on the longer streak, if the two agree.
    shortest : float
        Share of the length of the longest; a shorter streak agrees with everything.
    long : float
        Share of the length of the longest; a shorter streak lacks a part of the path.
    thick : float
        Ratio to the median thickness; a thicker one is that of a large light.

    """

    levels: tuple[float, ...] = (0.9, 0.6, 0.35)
    most_pieces: int = 300
    least_side: int = 7
    longest_side: int = 44
    least_area: int = 10
    dark: float = 0.25
    peak: float = 0.9
    dark_part: float = 0.75
    ring: int = 3
    filled: float = 0.6
    slender: float = 2.2
    most: int = 24
    fewest: int = 3
    fewest_long: int = 2
    ridge: float = 0.7
    covered: float = 0.8
    shortest: float = 0.35
    long: float = 0.6
    thick: float = 1.6


@dataclass(frozen=True)
class StreakLightSettings:
    """Which pixels belong to a streak (`streak_light`).

    Parameters
    ----------
    ring : (int, int)
        Px around the bright piece, from and to: the surroundings.
    bright_part : float
        Share of the surroundings: their brighter part begins here.
    contrast : float
        Light of a streak over that of the brighter part of the surroundings, at least.
    least_light : float
        Light of a streak, relative to the surroundings, at least.
    lit : float
        Light, relative to the surroundings, from which a pixel is clearly lit.
    around : int
        Px around a streak that count, too.
    white : float
        Light from which a pixel counts as clipped.

    """

    ring: tuple[int, int] = (4, 12)
    bright_part: float = 0.75
    contrast: float = 3.0
    least_light: float = 0.08
    lit: float = 0.1
    around: int = 7
    white: float = 0.97


@dataclass(frozen=True)
class StreakFit:
    """A stage of the fit of a path to streaks.

    Parameters
    ----------
    tolerance : float
        Light: a larger residual counts hardly more.
    spacing : float
        Grid steps of the path for each control point.
    controls : (int, int)
        Control points, at least and at most.
    iterations : int
        Iterations of the descent, at most.
    bend_price : float
        Price of the squared bends of the control points, in grid steps.

    """

    tolerance: float
    spacing: float
    controls: tuple[int, int]
    iterations: int
    bend_price: float = 3e-3


@dataclass(frozen=True)
class DrawnPathSettings:
    """The path that the streaks draw (`drawn_path`).

    Tuned on twelve simulated photos by night (`docs/decisions.md`).

    Parameters
    ----------
    pixels : float
        Pixels of the finest scale in which streaks are sought, at most.
    scales : int
        Scales in which streaks are sought, each half as wide as the one before, at most.
    good : float
        Misfit with which neither a coarser scale nor a path that bends more is tried.
    better : float
        Ratio of the misfits: the other scale or path is taken only if it has less than this.
    most_misfit : float
        Misfit of a path, at most. In about 90 other photos, two have streaks that agree;
        their paths have 0.38 and more.
    most, fewest : int
        Streaks that the path is fitted to, at most and at least.
    first_paths : int
        Streaks whose shapes give first paths, at most.
    longest : float
        Grid steps: a longer first path is that of no lamp.
    continued : int
        Best first paths that go on.
    fits : tuple of StreakFit
        The stages.
    flexible : StreakFit
        A stage for paths that bend more. Straight streaks do not determine such a path.
    outlier, least_outlier : float
        A streak with a misfit above so many medians, and above so much, is left out.
    samples, density, most_samples : int, float, int
        Steps of time of a path: for the first places of the lamps; in the descent for each grid
        step, and at most.
    lights : (float, float, int)
        Light of a lamp: values that are tried at first, from, to, and how many.
    widths : tuple of float
        Px: standard deviations of a lamp that are tried at first.
    lights_between, widths_between : (float, float)
        Limits of both.
    usual_width, width_price : float
        Px, and the price of the squared logarithm of a width over it.
    roll_price, middle_price : float
        Prices of the squared roll of the path, and of the squared mean of the control points, in
        grid steps.

    """

    pixels: float = 1.2e6
    scales: int = 2
    good: float = 0.15
    better: float = 0.6
    most_misfit: float = 0.3
    most: int = 10
    fewest: int = 3
    first_paths: int = 4
    longest: float = 110.0
    continued: int = 4
    fits: tuple[StreakFit, ...] = (
        StreakFit(0.4, 8.0, (5, 9), 50),
        StreakFit(0.25, 4.0, (8, 24), 100),
        StreakFit(0.2, 4.0, (8, 24), 120),
    )
    flexible: StreakFit = StreakFit(0.2, 2.5, (8, 40), 150, 1e-3)
    outlier: float = 2.5
    least_outlier: float = 0.15
    samples: int = 80
    density: float = 1.6
    most_samples: int = 150
    lights: tuple[float, float, int] = (8.0, 3000.0, 9)
    widths: tuple[float, ...] = (0.8, 1.3)
    lights_between: tuple[float, float] = (3.0, 1e5)
    widths_between: tuple[float, float] = (0.5, 1.6)
    usual_width: float = 0.9
    width_price: float = 1e-2
    roll_price: float = 1e-3
    middle_price: float = 1e-5
