"""The constants of the estimate by night: the streaks of lamps, and the path that draws them."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["DrawnPathSettings", "StreaksSettings"]


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
    full : float
        Share of the brightest light of a streak that counts as 1.
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
    width : float
        Sigma of the light across a streak, per px of thickness.
    least_width : float
        Px: the same sigma, at least.

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
    full: float = 0.8
    most: int = 24
    fewest: int = 3
    fewest_long: int = 2
    ridge: float = 0.7
    covered: float = 0.8
    shortest: float = 0.35
    long: float = 0.6
    thick: float = 1.6
    width: float = 0.5
    least_width: float = 0.6


@dataclass(frozen=True)
class DrawnPathSettings:
    """The path that draws all streaks at once (`drawn_path`).

    Tuned on six simulated photos by night (`docs/decisions.md`).

    Parameters
    ----------
    pixels : float
        Pixels of the scale in which streaks are sought, at most.
    roll : int
        Grid steps of roll to both sides.
    around : int
        Px: side of the window around the ridge of a streak; its rotations may draw the streak.
    most_places : int
        Rotations without roll, at most; with more there is no path.
    rounds : int
        Fits; the first one is that of the longest streak alone.
    nearby : int
        Px by which a streak moves in a round, at most.
    ridge : float
        Share of the diagonal; it grows with the square of the roll.
    cut : float
        Share of the kernel's weight that is noise.
    least_explained : float
        Share of the energy of the streaks that one path explains, at least.
    light : float
        Share of the kernel's weight: rotations that hold less are discarded.
    hidden : float
        Px that are hidden around bright lights, per px of the extent.
    least_hidden : int
        Px: the same, at least.
    most_hidden : float
        Share of the frame that is hidden; with more there is no path.
    bright : float
        Light: a brighter pixel is hidden with its surroundings.

    """

    pixels: float = 1.2e6
    roll: int = 4
    around: int = 5
    most_places: int = 300
    rounds: int = 4
    nearby: int = 6
    ridge: float = 0.003
    cut: float = 0.03
    least_explained: float = 0.65
    light: float = 1e-4
    hidden: float = 0.3
    least_hidden: int = 4
    most_hidden: float = 0.25
    bright: float = 0.35
