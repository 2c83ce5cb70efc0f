"""The constants of the tiles: which ones are taken, how large they are, and their rims."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Budget", "TileChoiceSettings", "TilePlanSettings", "TilesSettings"]


@dataclass(frozen=True)
class Budget:
    """Number of pixels of the tiles.

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    tiles : float
        Pixels of all chosen tiles.
    frame : float
        Pixels of the largest frame that tiles cover wholly.
    blocks : float
        Largest number of pixels of all blocks: the tiles and the room around them. Where a kernel
        rolls much, small tiles with wide rooms would cost several times as much as others.

    """

    tiles: float = 0.15e6
    frame: float = 0.15e6
    blocks: float = 0.5e6


@dataclass(frozen=True)
class TileChoiceSettings:
    """Which tiles are informative (`tile_choice`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`. `isolated_focus` and
    `texture` were chosen on 41 photos of it and checked on 23 of other scenes, by how much better
    the true kernel explains the chosen tiles than turned, shrunk and stretched ones do. No record
    says more.

    Parameters
    ----------
    focus : float
        Exponent of a tile's focus in its weight, no unit. A larger one favours tiles in focus
        more.
    isolated_focus : float
        The same exponent, where isolated edges are wanted.
    texture : float
        Share of the bound of the gradients: where isolated edges are wanted, a pixel with a longer
        gradient is not plain.
    largest_view : float
        Pixels of the view, the scale that the information is measured on, at most.
    apart : float
        Tile sizes: least distance between two tiles.
    nearest : float
        Tile sizes: distance between two possible places.
    least_hop : int
        Px of the scale: the same distance, at least.
    clipped : float
        A tile's weight is 1 less this times its share of clipped pixels.
    bound : float
        Quantile of the gradients: a stronger edge counts only this much.
    above_noise : float
        Standard deviations of the noise: the same bound, at least.
    least_noise : float
        Share of the mean gradient: a smaller noise counts as this.
    unsure : float
        Share of the noise that is added to the mean gradient around an edge; so faint edges
        count as shorter ones.
    focus_sigmas : (float, float)
        Px of the view: smoothing of the fine and of the coarse picture that measure the focus.
    directions : int
        Number of directions in half a turn.
    lively : float
        Quantile of the tiles' contrast: a weaker tile does not define what is in focus.
    focused : float
        Quantile of the steepness of edges: a tile this steep is in focus.
    least_width : int
        Px of the view: a narrower blur counts as this wide.
    least_information : float
        Share of the most informative tile: a tile with less is flat.
    prior : float
        Share of the mean information: what is known before the first tile.

    """

    focus: float = 4.0
    isolated_focus: float = 3.0
    texture: float = 0.15
    largest_view: float = 0.8e6
    apart: float = 0.75
    nearest: float = 0.5
    least_hop: int = 8
    clipped: float = 3.0
    bound: float = 0.98
    above_noise: float = 3.0
    least_noise: float = 1e-3
    unsure: float = 0.3
    focus_sigmas: tuple[float, float] = (0.7, 6.0)
    directions: int = 4
    lively: float = 0.5
    focused: float = 0.9
    least_width: int = 3
    least_information: float = 1e-9
    prior: float = 1e-3


@dataclass(frozen=True)
class TilePlanSettings:
    """Where tiles lie and how large they are (`tile_plan`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    fields : int
        Number of fields of the chessboard across the frame.
    colours : int
        Number of colours of the chessboard; the tiles on one of them are kept apart.
    least, largest : int
        Px of the scale: least and largest side of a tile.
    turn : float
        Px: largest difference between the displacements of a tile's two ends.
    fewest : int
        Least number of tiles.
    narrow : float
        Px of the scale: least length of the edges that count.
    cut : float
        Share of the largest weight: smaller weights do not count for the width of a kernel.
    budget : Budget
        Number of pixels of the tiles, unless another one is asked for.

    """

    fields: int = 12
    colours: int = 3
    least: int = 48
    largest: int = 128
    turn: float = 3.0
    fewest: int = 6
    narrow: float = 8.0
    cut: float = 0.05
    budget: Budget = Budget()


@dataclass(frozen=True)
class TilesSettings:
    """The rims of tiles (`tiles`).

    Tuned with the whole estimate on the set `tune` of `bench.py shakes`; no record says more.

    Parameters
    ----------
    least_room : int
        Px of the scale: least room on each side of the middle.
    ramp : int
        Px of the scale: width of the ramps of the edges' window.
    inset : int
        Ratio of the largest displacement to the border of the middle that this window leaves out.
    least_window : float
        Weight of the photo in the room, 0..1: with less, the edges there do not count.
    known : float
        Weight of the photo in the middle, 0..1: a pixel with less is unknown and no data.

    """

    least_room: int = 6
    ramp: int = 4
    inset: int = 4
    least_window: float = 0.05
    known: float = 0.99
